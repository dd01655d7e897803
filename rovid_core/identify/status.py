"""The status of a degree of freedom: what decides ``converged``, and the reasons if it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Final

from rovid_core.identify.excitation import BATCH, Excitation, Gram, MIN_EXCITATION
from rovid_core.identify.last_minute import KEYS, LastMinute
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import Four, OWN
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

STATUSES = ('waiting', 'unexcited', 'converging', 'converged', 'frozen', 'invalid', 'stale')
"""Of a DOF; the last one is what an estimate is called that has made no step for too long."""

# A converged model is converging again above this times the limit to become converged.
HYSTERESIS: Final = 2.0
# By which weaker thrust of half of its thrusters scales a mass, from which that is said.
SCALED: Final = 0.02
PERIOD: Final = 1.0  # event time [s] from one judgement to the next


@dataclass(frozen=True)
class Judgement:
    """A status and its reasons."""

    status: str  # one of ``STATUSES``
    method_reasons: tuple[str, ...] = ()  # reasons from the method and its convergence
    gram: Gram | None = None  # excitation of the data; what they do not show is a reason too

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return why the status is no better, in words."""
        return self.method_reasons + (() if self.gram is None else self.gram.reasons)


WAITING = Judgement('waiting')
UNEXCITED = Judgement('unexcited', ('no thrust',))
FROZEN = Judgement('frozen')
CONVERGING = Judgement('converging')


class DofStatus:
    """
    Judge one degree of freedom after every step; time is the event time of the steps.

    The status is ``invalid`` when the last step was refused, ``frozen`` while nothing is
    adapted, and ``unexcited`` while there is no thrust. It is ``converged`` when the standard
    deviation of alpha, and that of the model's acceleration over the latest data, are below
    the method's ``converged_share`` of alpha and that acceleration, and the method has no doubt
    of its own. A method without a covariance has converged
    when the mean of its parameters changes the acceleration by less than this from one window of
    three adaptation times to the next. A method that does not judge its own errors has to predict
    the last minute besides, which has to show the mass (``LastMinute``). Otherwise the status is
    ``converging``.

    Parameters
    ----------
    name : str
        Of the DOF.
    weaker : dict of str to float
        The DOFs that show that the vehicle's thrusters push otherwise backwards, and by how much
        that scales a mass, 0 where it is not known; shared by all.
    hides_weaker : bool
        Whether this DOF cannot say so itself. All believe the others unless they show or have it.
    of_wrench : bool
        Whether it is not known which thrusters drive it.

    Attributes
    ----------
    settled : bool
        Whether the model may be used: it has converged and nothing has spoken against it since. It
        stays so without thrust, and while nothing is adapted.
    fit : float
        How much of the motion the model predicts without corrections: 1 - rms(error) / std, over
        up to a minute; NaN at first.
    scale_in_doubt : float
        Share of the thrust that may not be there, as other DOFs show and this one does not have.

    """

    def __init__(self, scales: Scales, adaptation_time: float, name: str = '',
                 weaker: dict[str, float] | None = None, hides_weaker: bool = False,
                 of_wrench: bool = False) -> None:
        self._scales = scales
        self._name, self._hides_weaker, self._of_wrench = name, hides_weaker, of_wrench
        self._weaker = {} if weaker is None else weaker
        self._drift = _Drift()
        self._set_times(adaptation_time)
        self.reset()

    def retune(self, adaptation_time: float) -> None:
        """Change the adaptation time [s] of the method."""
        self._set_times(adaptation_time)
        self._excitation.memory = self._memory

    def reset(self) -> None:
        """Forget the data."""
        self._excitation = Excitation(self._scales, self._memory)
        self._steps: list[Step] = []  # not yet in the excitation
        self._drift.reset()
        self._last_minute = LastMinute(self._scales)
        self._time = 0.0
        self._judgement = CONVERGING
        self.scale_in_doubt = 0.0
        self._weaker.pop(self._name, None)
        self._was_excited = False
        self._knows = False
        self.settled = False
        self.fit = math.nan

    def update(self, identifier: Identifier, step: Step, refused: str, adapt: bool) -> Judgement:
        """Return the status after a step; ``refused`` is the reason if it was refused, or ''."""
        if refused:
            return Judgement('invalid', (refused,))
        self._steps.append(step)
        self._time += step.dt
        if not identifier.judges_errors:
            self._last_minute.add_step(
                step, (*identifier.parameters, *identifier.couplings))
        excited = identifier.excitation >= MIN_EXCITATION
        self._was_excited = self._was_excited or excited
        if len(self._steps) == BATCH:
            self._add_steps()
        if self._time >= PERIOD:
            self._add_steps()
            gram = self._excitation.update_fading()
            if not adapt:
                self._drift.reset()
                self._judgement = Judgement('converging', (), gram)
                if excited:
                    self.settled = not self._reason(identifier, self._objection(
                        gram, identifier, self.settled, adapt))
            elif excited:
                self._judgement = self._judge(gram, identifier)
                self.settled = self._judgement.status == 'converged'
            self.fit = identifier.fit if identifier.judges_errors else self._last_minute.fit
            self._time = 0.0
        if not adapt:
            return FROZEN
        return self._judgement if excited else UNEXCITED

    @property
    def of_all(self) -> Judgement:
        """Return the judgement while there was thrust last, or that there never was any."""
        return self._judgement if self._was_excited else UNEXCITED

    def verdict(self) -> str:
        """Return what all data since the start do not show, '' if they show everything."""
        self._add_steps()
        if self._knows or self._judgement.status == 'converged':
            return ''  # whatever the shape of the regressors
        return '; '.join(self._excitation.since_start().reasons)

    def _add_steps(self) -> None:
        self._excitation.add_steps(self._steps)
        self._steps.clear()

    def _set_times(self, adaptation_time: float) -> None:
        self._memory = min(max(60.0, 10.0 * adaptation_time), 1e9)
        self._drift.window = max(3.0 * adaptation_time, 3.0 * PERIOD)

    def _judge(self, gram: Gram, identifier: Identifier) -> Judgement:
        own = self._objection(gram, identifier, self._judgement.status == 'converged', True)
        if not self._hides_weaker and (_scaled(identifier) > SCALED or _names(identifier, own)):
            self._weaker[self._name] = _scaled(identifier)
        else:
            self._weaker.pop(self._name, None)
        self.scale_in_doubt = max(self._weaker.values()) if self._of_others() else 0.0
        reason, note = self._reason(identifier, own), identifier.note
        # a covariance that says that all is known outweighs the shape of the regressors
        self._knows = bool(identifier.covariance) and not (reason and _uncertain(
            gram, identifier.parameters, identifier.covariance, identifier.converged_share))
        excitation = None if self._knows else gram
        texts = tuple([text for text in (note, '' if reason in note else reason) if text])
        return Judgement('converging' if reason else 'converged', texts, excitation)

    def _objection(self, gram: Gram, identifier: Identifier, trusted: bool, adapt: bool) -> str:
        """Return why the model may not be used yet, or no more if it is trusted; '' if it may."""
        limit = identifier.converged_share * (HYSTERESIS if trusted else 1.0)
        parameters, covariance = identifier.parameters, identifier.covariance
        if covariance:
            reason = _uncertain(gram, parameters, covariance, limit) or identifier.doubt
        elif adapt:
            reason = self._drift.update(gram, parameters, self._time, limit)
        else:
            reason = '' if trusted else 'the parameters are frozen'
        if not (reason or identifier.judges_errors):
            reason = self._last_minute.doubt(trusted)
        return reason

    def _reason(self, identifier: Identifier, own: str) -> str:
        """Return an objection of this DOF's own, or what is known of how the thrusters push."""
        return self._of_others() or own or (
            'until that is taken into account the mass is off by as much'
            if _names(identifier, own) else '')

    def _of_others(self) -> str:
        """Return what other DOFs show that this one does not have, '' for nothing."""
        has = OWN[0] in self._scales.couplings and not self._hides_weaker
        if has or not self._weaker or self._name in self._weaker:
            return ''
        advice = (': log what each thruster is commanded' if self._of_wrench else
                  KEYS['reverse_thrust'])
        return (f'{min(self._weaker)} shows that the thrusters push otherwise backwards, '
                f'which scales this mass, too{advice}')


def _scaled(identifier: Identifier) -> float:
    """Return by how much a mass is off where half of the thrusters push as was found."""
    return 0.5 * (1.0 - min(identifier.thrusters.shares))


def _names(identifier: Identifier, own: str) -> bool:
    """Tell whether weaker thrust backwards is named, but not taken into account."""
    return not _scaled(identifier) and any(
        KEYS['reverse_thrust'] in text for text in (identifier.note, own))


def _uncertain(gram: Gram, parameters: Four, covariance: Sequence[float], limit: float) -> str:
    """Return what is too uncertain by the covariance, '' if nothing."""
    typical = gram.acceleration(parameters)
    share = gram.uncertainty(covariance) / typical if typical > 0.0 else math.inf
    alpha = math.sqrt(max(covariance[0], 0.0)) / parameters[0]
    # not (x < limit) is also true for NaN
    for what, known in (('mass', alpha), ('acceleration', share)):
        if not known < limit:
            far = (f'known to {_percent(known)}, not yet to {_percent(limit)}' if known < 1.0
                   else 'not known yet')
            return f'the {what} is {far}: drive this axis longer, or with more thrust'
    return ''


class _Drift:
    """The change of the parameters' mean from one window of time to the next."""

    window: float  # [s]

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the means."""
        self._sum: Four = (0.0,) * 4
        self._time = 0.0
        self._means: tuple[Four, ...] = ()  # the last two

    def update(self, gram: Gram, parameters: Four, span: float, limit: float) -> str:
        """Add the parameters of the last ``span`` [s]; return why they have not settled, or ''."""
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
        return ''


def _percent(share: float) -> str:
    # rounded up: what is not yet known to 10 % is not said to be
    return f'{math.ceil(100.0 * share - 1e-6)} %' if share < 10.0 else 'more than 1000 %'
