"""How far the estimate of a degree of freedom can be trusted, and why not further."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from rovid_core.identify.excitation import Excitation, Gram, LEAST_EXCITATION
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.settings.scales import Scales

STATUSES = ('waiting', 'unexcited', 'converging', 'converged', 'frozen', 'invalid')

CONVERGED = 0.05
"""Share of the typical acceleration, and of alpha, to which a converged model is known."""

LOST = 2.0 * CONVERGED
"""At which it is no longer converged: further up, so that noise does not switch it."""

PERIOD = 1.0
"""Event time [s] from one judgement to the next."""


@dataclass(frozen=True)
class Judgement:
    """
    A status, and what it comes from.

    Attributes
    ----------
    status : str
        One of ``STATUSES``.
    said : tuple of str
        Reasons that the method gives.
    gram : Gram or None
        What the data are; what they do not show are reasons too.

    """

    status: str
    said: tuple[str, ...] = ()
    gram: Gram | None = None

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return why the status is no better, in words."""
        return self.said if self.gram is None else (*self.said, *self.gram.reasons)


WAITING = Judgement('waiting')
UNEXCITED = Judgement('unexcited', ('no thrust',))
FROZEN = Judgement('frozen')
CONVERGING = Judgement('converging')


class DofStatus:
    """
    Judge one degree of freedom after every step, by event time alone.

    It is ``invalid`` when the last step was refused, ``frozen`` while nothing is adapted,
    ``unexcited`` while there is no thrust. It has ``converged`` when both the standard
    deviation of alpha and that of the model's acceleration over the recent data are below
    ``CONVERGED`` of alpha and of that acceleration. For a method without a covariance it
    has when the mean of the parameters moves the acceleration by less than that over three
    adaptation times, and the data show the mass at all. Until then it is ``converging``.

    Parameters
    ----------
    scales : Scales
        Of the degree of freedom.
    adaptation_time : float
        Of the method [s].

    """

    def __init__(self, scales: Scales, adaptation_time: float) -> None:
        self._scales = scales
        self._memory = min(max(60.0, 10.0 * adaptation_time), 1e9)
        self._drift = _Drift(max(3.0 * adaptation_time, 3.0 * PERIOD))
        self.reset()

    def retune(self, adaptation_time: float) -> None:
        """Take another adaptation time [s] of the method."""
        self._memory = min(max(60.0, 10.0 * adaptation_time), 1e9)
        self._excitation.memory = self._memory
        self._drift.window = max(3.0 * adaptation_time, 3.0 * PERIOD)

    def reset(self) -> None:
        """Forget the data."""
        self._excitation = Excitation(self._scales, self._memory)
        self._drift.reset()
        self._since = 0.0
        self._judged = CONVERGING

    def after(self, identifier: Identifier, step: Step, refused: str, adapt: bool) -> Judgement:
        """Return the status after a step; ``refused`` is why it was, or ''."""
        if refused:
            return Judgement('invalid', (refused,))
        self._excitation.step(step)
        self._since += step.dt
        excited = identifier.excitation >= LEAST_EXCITATION
        if self._since >= PERIOD:
            gram = self._excitation.recent()
            if not adapt:
                self._drift.reset()
                self._judged = Judgement('converging', (), gram)
            elif excited:
                self._judged = self._judge(gram, identifier)
            self._since = 0.0
        if not adapt:
            return FROZEN
        return self._judged if excited else UNEXCITED

    def verdict(self) -> str:
        """Return what all data since the start leave open, '' if nothing."""
        return '; '.join(self._excitation.whole().reasons)

    def _judge(self, gram: Gram, identifier: Identifier) -> Judgement:
        limit = LOST if self._judged.status == 'converged' else CONVERGED
        parameters, covariance = identifier.parameters, identifier.covariance
        if covariance:
            open_ = _uncertain(gram, parameters, covariance, limit)
        else:
            open_ = self._drift.open(gram, parameters, self._since, limit)
        # where a covariance says that all is known, the regressors may look as they like
        shapes = None if covariance and not open_ else gram
        said = [text for text in (identifier.note, open_) if text]
        return Judgement('converging' if open_ else 'converged', tuple(said), shapes)


def _uncertain(gram: Gram, parameters: Four, covariance: Sequence[float], limit: float) -> str:
    """Return what a covariance leaves open, '' when the model is known."""
    typical = gram.acceleration(parameters)
    share = gram.uncertainty(covariance) / typical if typical > 0.0 else math.inf
    alpha = math.sqrt(max(covariance[0], 0.0)) / parameters[0]
    # not (x < limit): a NaN is not known either
    if not alpha < limit:
        return f'the mass is known to {_percent(alpha)}'
    if not share < limit:
        return f'the acceleration is known to {_percent(share)}'
    return ''


class _Drift:
    """How far the mean of the parameters moves from one window of time to the next."""

    def __init__(self, window: float) -> None:
        self.window = window
        self.reset()

    def reset(self) -> None:
        self._sum: Four = (0.0,) * 4
        self._time = 0.0
        self._means: tuple[Four, ...] = ()  # the last two

    def open(self, gram: Gram, parameters: Four, span: float, limit: float) -> str:
        """Take the parameters that stood for ``span`` [s]; return what is still open, or ''."""
        (a, b, c, d), (p, q, r, s) = self._sum, parameters
        self._sum = (a + span * p, b + span * q, c + span * r, d + span * s)
        self._time += span
        if self._time >= self.window:
            a, b, c, d = self._sum
            time = self._time
            self._means = (*self._means[-1:], (a / time, b / time, c / time, d / time))
            self._sum, self._time = (0.0,) * 4, 0.0
        if len(self._means) < 2:
            return 'the parameters have not settled yet'
        typical = gram.acceleration(self._means[1])
        (a, b, c, d), (p, q, r, s) = self._means
        moved = gram.acceleration((p - a, q - b, r - c, s - d))
        if not moved < limit * typical:
            share = _percent(moved / typical if typical > 0.0 else math.inf)
            return f'the parameters move by {share} of the acceleration in {self.window:.3g} s'
        return '' if gram.shows_mass else 'the mass does not show'


def _percent(share: float) -> str:
    return f'{100.0 * share:.0f} %' if share < 10.0 else 'more than 1000 %'
