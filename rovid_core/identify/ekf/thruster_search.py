"""The search for what the thrusters have besides what the configuration says of them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, Generic, NamedTuple

import numpy as np
from rovid_core.identify.ekf.batch_start import BatchStart, finish, finite_number, PASSES
from rovid_core.identify.ekf.filter_bank import FilterBank, M, MARGIN
from rovid_core.identify.ekf.normalised_model import DELAYS
from rovid_core.identify.ekf.single.watched_lag import LAG
from rovid_core.model.dofs import OWN
from rovid_core.model.thrusters import Thrusters

REVERSE_THRUST, REVERSE_DRAG = OWN

TORQUE: Final = 'torque'
"""The kind of lag that propellers have which a torque turns."""

SIZES: Final = 8
IN_VAIN: Final = 2
"""How many lags of a kind are tried, and after how many none is taken to be better."""

BEYOND: Final = 1.5
"""By which the lag is larger or smaller that is tried beyond those that were."""

NEAR: Final = 0.03
"""Share of a lag by which another one is no other."""

WIDE: Final = 0.25
"""The same within which the likelihood is about a parabola."""


class Heard(NamedTuple):
    """
    What other DOFs of the vehicle show of its thrusters.

    Attributes
    ----------
    lag : float
        [s] 0 for none.
    turns : bool
        Whether it is that of the propellers' turns.

    """

    lag: float = 0.0
    turns: bool = False

    def and_of(self, thrusters: Thrusters) -> Heard:
        """Return it with what one more shows."""
        # a torque's lag is that at a force, which others measure in other units
        known = thrusters.lag and not thrusters.lag_at
        return Heard(thrusters.lag, thrusters.turns) if known else self


class SearchBeside(Generic[M]):
    """
    A search that goes on beside a filter, which takes what is found when it is over.

    It goes through the data dozens of times, which would hold up a live node for seconds; so it
    is done on a copy of the filter, a part with each measurement.

    Parameters
    ----------
    search : callable
        Makes a search on a copy of the filter, from its state.
    pace : float
        Measurements a second that are gone through while the filter itself goes on.

    """

    def __init__(self, search: Callable[[Mapping[str, Any]], ThrusterSearch[M]],
                 pace: float) -> None:
        self._new, self._pace = search, pace
        self.drop()

    def drop(self) -> None:
        """End it without a result: the data that it is about are gone."""
        self._search: ThrusterSearch[M] | None = None
        self._begun: Mapping[str, Any] = {}
        self._gone, self._left = 0, 0.0

    @property
    def is_on(self) -> bool:
        """Tell whether there is one."""
        return self._search is not None

    def begin(self, bank: FilterBank[M], start: BatchStart[M] | None, heard: Heard,
              state: Callable[[], dict[str, Any]]) -> None:
        """Begin one on a copy of the filter as it is, where there is something to look for."""
        if self.is_on or not self._pace or start is None or not (start.may_search and (
                named_thrusters(bank) or _told(bank.best.thrusters, heard))):
            return
        start.failed = start.duration
        self._begun = state()
        self._search = self._new(self._begun)

    def go_on(self, duration: float, bank: FilterBank[M], start: BatchStart[M] | None,
              use: Callable[[Any], list[float]]) -> bool:
        """
        Go on with as much as is due while so much is measured; tell if that changes the filter.

        Parameters
        ----------
        duration : float
            [s], ``math.inf`` for all there is.
        bank, start, use
            Those of the filter itself, as of a ``ThrusterSearch``.

        """
        search = self._search
        if search is None or start is None:
            return False
        self._left += self._pace * duration
        while self._left > 0.0:
            part = next(search.parts, 0)
            if not part:
                self.drop()
                return search.hand_over(bank, start, use)
            self._gone += 1
            self._left -= part
        return False

    def state(self) -> dict[str, Any] | None:
        """Return all that is needed to go on from here."""
        return None if self._search is None else {
            'begun': self._begun, 'gone': self._gone, 'left': self._left}

    def restore(self, state: Mapping[str, Any] | None) -> None:
        """Do again what was done by ``state``; raises ValueError if it does not fit."""
        self.drop()
        if state is None:
            return
        search = self._search = self._new(state['begun'])
        self._begun = state['begun']
        self._gone, self._left = int(state['gone']), finite_number(state['left'])
        for _ in range(self._gone):
            if not next(search.parts, 0):
                raise ValueError('a search that was over sooner')


class ThrusterSearch(Generic[M]):
    """
    What makes all data so far likelier: what the blocks name of the thrusters.

    Parameters
    ----------
    bank : FilterBank
        Its members, which become those with what is found.
    start : BatchStart
        The data.
    use : callable
        Takes other thrusters for all members that are made from then on, and returns
        parameters of the best one whose delay is shorter by the lag.
    heard : Heard
        The lag that other DOFs of the vehicle show.

    Attributes
    ----------
    parts : iterator of int
        Does the search, and gives how many measurements each part of it went through.

    """

    def __init__(self, bank: FilterBank[M], start: BatchStart[M] | None,
                 use: Callable[[Any], list[float]], heard: Heard) -> None:
        if start is None:
            raise ValueError('a search in no data')
        self._bank, self._start, self._use, self._heard = bank, start, use, heard
        self._succeeded = False
        self.parts = self._search()

    def hand_over(self, bank: FilterBank[M], start: BatchStart[M],
                  use: Callable[[Any], list[float]]) -> bool:
        """Let another filter have what was found, its own given; tell if there is something."""
        if not self._succeeded:
            return False
        before, back = bank.best.thrusters, bank.way_back()
        bank.members, bank.number = list(self._bank.members), self._bank.number
        use(bank.best.thrusters)
        # with what was measured meanwhile
        if not finish(bank.go_through_again(start, (), False)):
            use(before)
            back()
            return False
        start.failed = 0.0
        start.wait(False)
        return True

    def _search(self) -> Generator[int, None, None]:
        """
        Go through all data with what is named, and keep it where it is better.

        Clearly so, for something new; of what was found the size may become a better one, and a
        lag that another DOF shows clearly has to be no more than better here: the thrusters of a
        vehicle are of one kind, and a delay hides a lag where couplings hide the rest.
        """
        bank = self._bank
        # compared are members that went through all the same data at parameters that fit them
        if not (yield from bank.go_through_again(self._start, (), False)):
            return
        before = bank.best.thrusters
        least, found, back = bank.least, bank.best.blocks.found, bank.way_back()
        taken, there = None, back
        named, proposals = named_thrusters(bank), []
        for better in named:
            proposals.append((yield from self._likeliest_lag(before, better)))
        proposals.append((yield from self._alternative(before, named)))
        told = _told(before, self._heard)
        proposals += told
        for better in proposals:
            if better != before and (yield from self._solve(better)):
                value = bank.least
                if bank.best.blocks.found != found and better not in told:
                    value += _margin(bank.best)
                if value < least:
                    least, taken, there = value, bank.best.thrusters, bank.way_back()
            self._use(before)
            back()
        if taken is not None:
            self._succeeded = True
            there()

    def _solve(self, better: Any) -> Generator[int, None, bool]:
        """Go through all data with thrusters; tell if it went well."""
        bank, start = self._bank, self._start
        # twice: where fixes come fast there are few passes
        return ((yield from bank.solve(start, [self._use(better)], PASSES, True, False))
                and (yield from bank.go_through_again(start, (), False)))

    def _likeliest_lag(self, before: Any, better: Any) -> Generator[int, None, Any]:
        """Return thrusters that lag in the way, and by as much, as is likeliest."""
        kind = _kind(better)
        if kind in ('', _kind(before)) and kind != TORQUE:
            return better  # the blocks say how much
        if _lag(before):  # it is of the other kind, if it is
            return (yield from self._sized(before, better))[0]
        force, least, _ = yield from self._sized(before, _with(better, turns=False))
        of_turns, likelier, margin = yield from self._sized(before, _with(better, turns=True))
        return of_turns if likelier < least - margin else force

    def _alternative(self, before: Any, named: Sequence[Any]) -> Generator[int, None, Any]:
        """Return the lag that may look like what is named, and is likelier than none."""
        lag, lags = _lag(before), []
        names_lag = any(_lag(better) != lag for better in named)
        names_band = not any(one.found for one in _both(before)) and any(
            one.dead_band for better in named for one in _both(better))
        if names_band and not names_lag:
            lags += [_with(before, lag=LAG), _with(before, lag=LAG, turns=True)]
        if _kind(before) != TORQUE and (names_band or names_lag):
            lags.append(_with(before, lag=lag or LAG, turns=True, lag_at=1.0, dead_band=0.0))
        best, least = before, self._bank.members[0].innovations.likelihood
        for other in lags:
            found, value, margin = yield from self._sized(before, other)
            if value < least - margin:
                best, least = found, value
        return best

    def _sized(self, before: Any,
               better: Any) -> Generator[int, None, tuple[Any, float, float]]:
        """Return thrusters with the likeliest lag of a kind, how likely it is, and its margin."""
        bank, back, lag = self._bank, self._bank.way_back(), _lag(better)
        # by the first member: an unknown force of the others follows what is missing
        ends, bank.number = {_lag(before): bank.members[0]}, 0
        best, least, margin = before, bank.best.innovations.likelihood, 0.0
        tried = {} if _lag(before) else {0.0: least}
        with suppress(ArithmeticError, np.linalg.LinAlgError):
            for _ in range(SIZES):
                # from far away the passes may lead astray
                bank.members[0] = one = ends[min(ends, key=lambda end: abs(end - lag))]
                self._use(one.thrusters)
                bank.members[0] = ends[lag] = one = yield from self._start.solve(
                    one, [self._use(_with(better, lag=lag))])
                one.judge()
                tried[lag] = value = one.innovations.likelihood
                if value < least:
                    best, least, margin = one.thrusters, value, _margin(one)
                lag = next_lag(tried)
                if best is before and len(tried) > IN_VAIN or lag in tried:
                    break
        self._use(before)
        back()
        return best, least, margin


def named_thrusters(bank: FilterBank[M]) -> list[Any]:
    """
    Return thrusters that have what the best member says, and what the first one says.

    Where an unknown force follows what is missing, hardly any of the error is left to say it. But
    the first one takes drag in reverse for thrust, where the best one tells them apart.
    """
    named: list[Any] = []
    drag = _missing(bank.best)
    for member in (bank.best, bank.members[0]):
        better = member.better_thrusters
        is_drag = drag.endswith(REVERSE_DRAG) and (
            _missing(member) == drag.replace(REVERSE_DRAG, REVERSE_THRUST))
        if better is not None and better not in named and not is_drag:
            named.append(better)
    return named


def _missing(member: Any) -> str:
    """Return the name of what a model lacks, '' for nothing."""
    verdict = member.verdict
    return '' if verdict is None or verdict.missing is None else str(verdict.missing.name)


def read_heard(state: Any) -> Heard:
    """Return what a state has of it; ValueError if it does not fit."""
    lag, turns = state
    return Heard(finite_number(lag), bool(turns))


def _told(thrusters: Any, heard: Heard) -> list[Any]:
    """Return thrusters that lag as others were heard to, as a list; none where these lag."""
    return [_with(thrusters, lag=heard.lag, turns=heard.turns)] if (
        heard.lag and not _lag(thrusters)) else []


def _margin(member: Any) -> float:
    """Return by how much data have to be likelier with something new."""
    # where the blocks scatter more than the model says, the data are worth less
    return 0.0 if member.verdict is None else MARGIN * member.verdict.unexplained


def next_lag(tried: Mapping[float, float]) -> float:
    """
    Return the lag to try next [s], the best one where that is found.

    Parameters
    ----------
    tried : mapping of float to float
        -2 log of the likelihood of each lag that was tried, of one above 0 at least.

    """
    lags = sorted(tried)
    i = lags.index(min(lags, key=lambda lag: tried[lag]))
    best = lags[i]
    if i == len(lags) - 1:
        return min(BEYOND * best, DELAYS[1])
    if i == 0:
        return best / BEYOND if best else 0.5 * lags[1]
    (a, b, c), (fa, fb, fc) = lags[i - 1:i + 2], [tried[lag] for lag in lags[i - 1:i + 2]]
    one, other = (b - a) * (fb - fc), (b - c) * (fb - fa)
    lowest = b - 0.5 * ((b - a) * one - (b - c) * other) / (one - other)
    if abs(lowest - best) >= NEAR * best:
        return lowest
    # far from it the likelihood is no parabola: the wider side is looked into as well
    far = c if c - b > b - a else a
    return best if abs(far - best) < WIDE * best else 0.5 * (best + far)


def _both(thrusters: Any) -> list[Thrusters]:
    """Return those of one DOF or of two as a list."""
    return [thrusters] if isinstance(thrusters, Thrusters) else list(thrusters)


def _lag(thrusters: Any) -> float:
    return max(one.lag for one in _both(thrusters))


def _kind(thrusters: Any) -> str:
    """Return what lags, '' if nothing does."""
    one = _both(thrusters)[0]
    return '' if not one.lag else TORQUE if one.lag_at else 'turns' if one.turns else 'force'


def _with(thrusters: Any, **changes: Any) -> Any:
    """Return thrusters of one DOF or of two that differ in something."""
    changed = [one._replace(**changes) for one in _both(thrusters)]
    return changed[0] if isinstance(thrusters, Thrusters) else tuple(changed)
