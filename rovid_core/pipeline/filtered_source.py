"""A source of velocities with what its steps need from one to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rovid_core.model.dofs import OWN, THRUSTS
from rovid_core.model.lowpass import LowPass
from rovid_core.model.samples import Motion
from rovid_core.pipeline.planar_steps import PlanarSteps
from rovid_core.settings.run import Settings
from rovid_core.velocity.attitude_history import SharedMotion
from rovid_core.velocity.velocity_source import VelocitySource


class FilteredSource(VelocitySource):
    """
    A velocity source with the filters of its DOFs, and how far their steps have come.

    Parameters
    ----------
    settings, input, shared
        As of a ``VelocitySource``.
    warn : callable
        Called with one line if the samples come too slowly.
    planar : PlanarSteps or None
        What takes the steps of surge and sway together.

    Attributes
    ----------
    indices : tuple of int
        Numbers of its DOFs in ``settings.dofs``.
    velocity, force : LowPass
        Of these DOFs.
    held : Motion or None
        A velocity that waits for the force of its span.
    last : Motion or None
        Where the next step begins.
    couplings : tuple of str
        Of all its DOFs, each once, but for ``THRUSTS`` and ``OWN``.
    thrusts : tuple of int
        Numbers of the DOFs whose force is a coupling, behind these.
    own : list of (int, str)
        Those of ``OWN`` behind all of them, with the number of the DOF among those of the source.
    needs_others : bool
        Whether its steps need velocities or attitudes of other inputs.
    coupling_indices : list of tuple of int
        Which of all these each of its DOFs has, in the order of its settings.
    watched, watched_thrusts, watched_indices
        The same of the regressors that are watched; nothing waits for these.
    regressors : LowPass
        Of the couplings.
    last_regressors : tuple of float
        Those of the couplings over the interval of ``last``.
    planar : PlanarSteps or None
        As given where this is the source of surge and sway.

    """

    def __init__(self, settings: Settings, input: str, shared: SharedMotion,
                 warn: Callable[[str], None], planar: PlanarSteps | None) -> None:
        self.velocity = LowPass(settings.cutoff)
        self.force = LowPass(settings.cutoff)
        self.regressors = LowPass(settings.cutoff)
        super().__init__(settings, input, shared)
        self.indices = tuple(settings.dofs.index(d) for d in self.dofs)
        self.planar = planar if planar is not None and planar.input == input else None
        names = [settings.couplings(d) for d in self.dofs]
        self.couplings, forces = _parted([x for one in names for x in one if x not in OWN])
        self.own = [(j, x) for j, one in enumerate(names) for x in one if x in OWN]
        everything = [*self.couplings, *forces, *self.own]
        self.coupling_indices = [tuple([everything.index((j, x) if x in OWN else x) for x in one])
                                 for j, one in enumerate(names)]
        self.thrusts = tuple([settings.dofs.index(THRUSTS[x]) for x in forces])
        self.has_couplings = bool(everything)
        self.needs_others = bool(self.couplings) or self.planar is not None
        watched = [settings.watched(d) for d in self.dofs]
        self.watched, forces = _parted([x for one in watched for x in one])
        self.watched_thrusts = tuple([settings.dofs.index(THRUSTS[x]) for x in forces])
        everything = [*self.watched, *forces]
        self.watched_indices = [tuple([everything.index(x) for x in one]) for one in watched]
        self.last_regressors: tuple[float, ...] = ()
        self.held: Motion | None = None
        self.last: Motion | None = None
        self._warn: Callable[[str], None] | None = warn
        self._gaps = 0

    def change(self, settings: Settings) -> None:
        """Use other limits and another cutoff; the filters go on from where they are."""
        super().change(settings)
        self._is_chosen = settings.cutoff != Settings.cutoff  # else it follows the rate
        self.velocity.retune(settings.cutoff)
        self.force.retune(settings.cutoff)
        self.regressors.retune(settings.cutoff)

    def coupling_span(self, motion: Motion) -> tuple[int, int] | None:
        """
        Return the span [ns] over which a motion's couplings are means, None at a first point.

        It is the interval of the motion, or, of a point, the step that ends there.
        """
        if motion.start < motion.end:
            return motion.start, motion.end
        if self.last is not None and self.last.time < motion.time:
            return self.last.time, motion.time
        return None

    def interrupt(self) -> None:
        """Let the next measurement begin anew."""
        self.velocity.restart()
        self.force.restart()
        self.regressors.restart()
        self.last_regressors = ()
        self.held = self.last = None

    def note_gap(self) -> None:
        """Warn once when there are nothing but gaps."""
        self._gaps += 1
        if self._warn and self._gaps == 20 and not self.velocity.steps:
            self._warn(f'the messages of {self.input} are further apart than max_gap: '
                       'nothing can be identified from them')

    def warn_if_clamped(self) -> None:
        """Warn once when the samples come too slowly for the cutoff."""
        if not (self._warn and self._is_chosen):
            return
        steps, clamped = self.velocity.steps, self.velocity.clamped
        if steps >= 50 and clamped > steps // 2:
            self._warn(f'velocity.cutoff is above 0.4 of the rate of {self.input}, and '
                       'clamped to that')
            self._warn = None


def _parted(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return couplings that the motion makes, and those of ``THRUSTS``, each once."""
    once = tuple(dict.fromkeys(names))
    return (tuple([name for name in once if name not in THRUSTS]),
            tuple([name for name in once if name in THRUSTS]))
