"""What the live node, a replay and a simulation all run: order, steps, counters, controls."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

from rovid_core.identify.estimate import Estimate
from rovid_core.identify.method import Identifier
from rovid_core.identify.status import Judgement
from rovid_core.model.samples import Event
from rovid_core.ordering.event_order import EventOrder
from rovid_core.pipeline.identification import Identification
from rovid_core.pipeline.steps import Pipeline, Scorer, Water
from rovid_core.settings.run import Settings

STATE_VERSION = 1

MAX_WARNINGS = 1000
"""Warnings that wait to be told; of more, the oldest are lost."""


class Recorder(Protocol):
    """Writes down what the stream consumed, so that it can be replayed to the same bits."""

    def released(self, event: Event) -> None:
        """Record an event, in the order of release."""

    def controlled(self, name: str, value: str) -> None:
        """Record a control at its place between the events."""


@dataclass
class InputHealth:
    """How many samples of an input were used, and the gaps between those that came."""

    count: int = 0
    last_time: int | None = None  # [ns]
    longest_gap: float = 0.0  # [s]
    intervals: int = 0  # between the samples, and how long they are together [s]
    duration: float = 0.0

    @property
    def rate(self) -> float:
        """Return the mean rate [Hz] by event time, 0 before the second sample."""
        return self.intervals / self.duration if self.intervals else 0.0

    def add_time(self, time: int) -> None:
        """Add the event time [ns] of a sample."""
        if self.last_time is not None and time > self.last_time:
            gap = (time - self.last_time) * 1e-9
            self.duration += gap
            self.intervals += 1
            if gap > self.longest_gap:
                self.longest_gap = gap
        self.last_time = time


class Stream:
    """
    Messages in, estimates out.

    Parameters
    ----------
    settings : Settings
        The run.
    recorder : Recorder, optional
        Gets everything that is consumed.
    scorer : Scorer, optional
        Gets every step, to score the model afterwards.
    water : callable, optional
    whole : bool
        As of a ``Pipeline``.

    Attributes
    ----------
    rejected : dict
        (input, reason) -> how many samples or steps were refused.
    estimate : Estimate or None
        The last one.
    inputs : dict
        Input name -> InputHealth.
    reset_by_clock : bool
        Whether a clock that went back has put the parameters to their initial values.

    """

    def __init__(self, settings: Settings, *, recorder: Recorder | None = None,
                 scorer: Scorer | None = None, water: Water | None = None,
                 whole: bool = False) -> None:
        self.settings = settings
        self.rejected: dict[tuple[str, str], int] = {}
        self.estimate: Estimate | None = None
        self.reset_by_clock = False
        self.inputs = {name: InputHealth() for name in settings.used_inputs()}
        self._recorder = recorder
        self._warnings = deque([
            f'{dof} has no restoring moment in this model: only for a vehicle that is '
            'neutral in it' for dof in settings.dofs
            if dof in ('roll', 'pitch') and f'sin_{dof}' not in settings.couplings(dof)],
            MAX_WARNINGS)
        self._hints: deque[str] = deque((), MAX_WARNINGS)
        self._pipeline = Pipeline(
            settings, self.reject, self._warnings.append, self._hints.append, scorer, water,
            whole)
        keys = [(name, 0) for name in self.inputs if name not in ('thrusters', 'reference')]
        keys += [('thrusters', part) for part in range(len(settings.thrusters.topics))]
        self._order = EventOrder(keys, settings.wait, settings.time_jump, self.reject,
                                 self._warnings.append, settings.max_wait < 0.0)

    def receive(self, event: Event) -> list[Estimate]:
        """Add an event, in any order, and return the estimates that it releases."""
        released, jumped = self._order.push(event)
        if jumped:
            self._jump()
        return self._handle(released)

    def finish(self) -> list[Estimate]:
        """Release what is held: nothing that belongs before it may come any more."""
        estimates = self._handle(self._order.flush())
        self._pipeline.finish()
        return estimates

    def end(self) -> list[Estimate]:
        """Release what is held; the last estimate has the best of a log that is short."""
        estimates = self.finish()
        last = self._pipeline.conclude(self.estimate) if self.estimate is not None else None
        if last is not None:
            if estimates:
                estimates[-1] = last
            else:
                estimates = [last.replaced(stepped=())]
            self.estimate = last
        return estimates

    def reset(self) -> None:
        """Put the parameters back to their initial values, between two steps."""
        self._note('reset', '')
        self._pipeline.reset()

    def enable(self, adapt: bool) -> None:
        """Adapt the parameters, or freeze them while v_hat goes on."""
        self._note('enable', 'true' if adapt else 'false')
        self._adapt(adapt)

    def change(self, settings: Settings, told: str) -> None:
        """
        Use other gains, limits and ``enable``, between two steps; the estimates stay.

        Parameters
        ----------
        settings : Settings
            Those of now with other values of what can change: ``identifier`` without its
            method and integrator, ``cutoff``, ``gate``, ``max_speed``, ``max_gap``, ``max_wait``,
            ``thrusters.timeout``, ``enable``, ``checkpoint_period``.
        told : str
            What the recorder writes down about it, to be repeated in a replay.

        """
        self._note('parameters', told)
        if settings.max_wait != self.settings.max_wait:  # else a wait that grew stays
            self._order.change(settings.wait, settings.max_wait < 0.0)
        self._pipeline.change(settings)
        self.settings = settings
        self._pipeline.adapt = settings.enable

    def interrupt(self) -> list[Estimate]:
        """Release what is held, and start the histories anew: nothing is heard for a while."""
        estimates = self.finish()
        self._note('interrupt', '')
        self._order.restart()
        self._restart()
        return estimates

    def silent_estimate(self, now: int, ended: bool = False) -> Estimate | None:
        """
        Return what is left of the last estimate at a time [ns] up to which no step was made.

        None before the first step. Nothing is changed. It is for those who have a clock; a stream
        knows only how old a DOF is when another one makes a step. Where no more steps can come,
        it has ``ended``, and all DOFs are stale.
        """
        return self._pipeline.silent_estimate(now, ended) if self.estimate else None

    @property
    def adapting(self) -> bool:
        """Tell whether the parameters are being adapted."""
        return self._pipeline.adapt

    def identifier(self, dof: str) -> Identifier:
        """Return the identifier of a DOF."""
        return self._dof(dof).identifier

    def judgement(self, dof: str) -> Judgement:
        """Return the judgement of a DOF over all of the data: that while there was thrust last."""
        return self._dof(dof).judgement()

    def verdict(self, dof: str) -> str:
        """Return what the data since the start or a reset leave open of a DOF, '' if nothing."""
        return self._dof(dof).verdict()

    def _dof(self, name: str) -> Identification:
        return self._pipeline.dofs[self.settings.dofs.index(name)]

    def control(self, name: str, value: str) -> list[Estimate]:
        """
        Replay a recorded control; what was recorded before it is released first.

        Raises
        ------
        ValueError
            For a control that there is not.

        """
        estimates = self.finish()
        if name == 'reset':
            self.reset()
        elif name == 'enable':
            self.enable(value == 'true')
        elif name == 'interrupt':
            self.interrupt()
        elif name == 'time_jump':
            self._order.restart()
            self._jump()
        else:
            raise ValueError(f'an unknown control {name!r}')
        return estimates

    def reject(self, input: str, reason: str) -> None:
        """Count a refusal."""
        self.rejected[(input, reason)] = self.rejected.get((input, reason), 0) + 1

    def lag(self, input: str) -> float:
        """Return by how much [s] late samples of an input are behind the others, at most."""
        return self._order.lag(input)

    def rejected_by_reason(self) -> dict[str, int]:
        """Return how many samples or steps were refused, by reason."""
        total: dict[str, int] = {}
        for (_, reason), count in sorted(self.rejected.items()):
            total[reason] = total.get(reason, 0) + count
        return total

    def take_warnings(self) -> list[str]:
        """Return the warnings since the last call, a line each, those that only advise last."""
        warnings = [*self._warnings, *self._hints]
        self._warnings.clear()
        self._hints.clear()
        return warnings

    def state(self) -> dict[str, Any]:
        """Return the identifiers' state, of plain numbers, strings, lists and dicts."""
        return {
            'version': STATE_VERSION, 'method': self.settings.identifier.method,
            'adapt': self.adapting,
            'dofs': {name: {**self._terms(name), **self.identifier(name).state()}
                     for name in self.settings.dofs}}

    def restore(self, state: Mapping[str, Any]) -> None:
        """
        Go on from a state, all of it or nothing.

        Raises
        ------
        ValueError
            If it was made by another version, method or set of DOFs, terms or couplings, or
            holds values that are out of bounds.

        """
        version = state.get('version') if isinstance(state, Mapping) else None
        if version != STATE_VERSION:
            raise ValueError(f'version {version}, not {STATE_VERSION}')
        mine = self.state()
        if state.get('method') != mine['method']:
            raise ValueError(f'method {state.get("method")}, not {mine["method"]}')
        dofs = state.get('dofs')
        if not isinstance(dofs, Mapping) or list(dofs) != list(self.settings.dofs):
            raise ValueError(f'DOFs other than {", ".join(self.settings.dofs)}')
        for dof in self.settings.dofs:
            if not isinstance(dofs[dof], Mapping):
                raise ValueError(f'no state of {dof}')
            if {key: dofs[dof][key] for key in ('terms', 'couplings')
                    if key in dofs[dof]} != self._terms(dof):
                raise ValueError(f'other terms of {dof}')
        try:
            for dof in self.settings.dofs:
                self.identifier(dof).restore(dofs[dof])
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            for name in self.settings.dofs:
                self.identifier(name).restore(mine['dofs'][name])
            raise ValueError(f'{dof}: {error}') from error
        self._adapt(bool(state.get('adapt', True)))
        self._pipeline.refresh()

    def _terms(self, dof: str) -> dict[str, list[str]]:
        """Return the terms of a DOF's model, with its couplings if it has any."""
        couplings = list(self.settings.couplings(dof))
        return {'terms': list(self.settings.dof[dof].terms),
                **({'couplings': couplings} if couplings else {})}

    def _handle(self, events: list[Event]) -> list[Estimate]:
        estimates: list[Estimate] = []
        for event in events:
            if self._recorder is not None:
                self._recorder.released(event)
            time = event.time
            for sample in event.samples:
                health = self.inputs[sample.input]
                health.add_time(time)
                found = self._pipeline.add_sample(time, sample)
                if found is not None:
                    health.count += 1
                    estimates += found
        if estimates:
            self.estimate = estimates[-1]
        return estimates

    def _jump(self) -> None:
        self._note('time_jump', '')
        self._warnings.append('time jumped back: histories are started anew'
                              + (' and the parameters reset, see reset_on_time_jump' if
                                 self.settings.reset_on_time_jump else ''))
        self._restart()
        if self.settings.reset_on_time_jump:
            self._pipeline.reset()
            self.reset_by_clock = True

    def _restart(self) -> None:
        self._pipeline.restart()
        for health in self.inputs.values():
            health.last_time = None

    def _adapt(self, on: bool) -> None:
        self._pipeline.adapt = on
        self.settings = replace(self.settings, enable=on)

    def _note(self, name: str, value: str) -> None:
        if self._recorder is not None:
            self._recorder.controlled(name, value)
