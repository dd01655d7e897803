"""A run that is cut anywhere, saved as text and gone on from gives the same bits."""

from collections.abc import Iterator
import json
from pathlib import Path
import random
import struct
from typing import Any

from hypothesis import given, HealthCheck, Phase, settings as hypothesis_settings, strategies as st
import pytest
from rovid_core.identify.estimate import Estimate
from rovid_core.model.samples import Event, Sample
from rovid_core.settings.run import Settings
from rovid_core.snapshot import SnapshotError, Snapshots
from rovid_ros.commands.feeder import PipeFeeder
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.messages.convert import Converter

METHODS = ('aid', 'ekf', 'rls')

Action = Event | str
"""What a stream is given: an event, or a control."""


class Few(list[Any]):
    """A list of which a failing test does not print megabytes."""

    def __repr__(self) -> str:
        return f'{len(self)} states'


class Events(list[Event]):
    """Events of which a failing test does not print thousands."""

    def __repr__(self) -> str:
        return f'{len(self)} events'


def settings(repository: Path, method: str, **changes: Any) -> Settings:
    """Return the settings of a vehicle with three DOFs and slow sensors."""
    return settings_from({
        **load(repository / 'config' / 'jhurov.yaml'), 'identifier.method': method,
        'simulation.position_rate': 4.0, 'simulation.depth_rate': 3.0,
        'simulation.attitude_rate': 5.0, 'simulation.thruster_rate': 4.0,
        'max_wait': 0.5, **changes})


@pytest.fixture(scope='module')
def events(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Event]:
    """Return the events of 26 s, in which the filter goes through its start again."""
    path = tmp_path_factory.mktemp('log') / 'log.mcap'
    made = settings(repository, 'aid')
    simulate_log(made, path, 26.0, seed=3)
    converter = Converter(made, lambda *refused: pytest.fail(str(refused)))
    with Log([path]) as log:
        found = Events(event for m in log.messages(list(converter.topics))
                       for event in converter.events(m.topic, m.data, m.time))
    assert len(found) > 400
    return found


class Run:
    """A stream with its scores, that can be cut."""

    def __init__(self, made: Settings) -> None:
        self.feeder = PipeFeeder(made)
        self.stream = self.feeder.stream
        self.snapshots = Snapshots({'stream': self.stream})

    def take(self, action: Action) -> list[Estimate]:
        if isinstance(action, Event):
            return self.stream.receive(action)
        if action == 'reset':
            self.stream.reset()
        else:
            self.stream.enable(action == 'enable')
        return []

    def text(self) -> str:
        return json.dumps(self.snapshots.take(), allow_nan=False)

    def cut(self) -> 'Run':
        """Return another run that goes on from here."""
        other = Run(self.stream.settings)
        other.snapshots.put_back(json.loads(self.text()))
        return other

    def outcome(self) -> Any:
        """Return all that a user sees in the end, with the bits of every number."""
        dofs = self.stream.settings.dofs
        parameters = {dof: self.stream.identifier(dof).parameters for dof in dofs}
        return bits([
            self.stream.rejected, self.stream.take_warnings(), self.stream.estimate,
            [(self.stream.verdict(dof), self.feeder.scores.score(dof, parameters[dof]))
             for dof in dofs], self.stream.inputs])


def bits(values: object) -> Any:
    """Return values with every float as its bits, so that NaN is NaN and -0.0 is not 0.0."""
    if isinstance(values, float):
        return struct.pack('>d', values)
    if isinstance(values, (list, tuple)):
        return [bits(x) for x in values]
    if isinstance(values, dict):
        return {key: bits(x) for key, x in values.items()}
    names = getattr(values, '__dataclass_fields__', {})
    return [bits(getattr(values, name)) for name in names] if names else values


@pytest.mark.parametrize('method', METHODS)
def test_cut_at_every_message(method: str, events: list[Event], repository: Path) -> None:
    made = settings(repository, method)
    straight, run, steps = Run(made), Run(made), 0
    for event in events:
        expected = straight.take(event)
        assert bits(run.take(event)) == bits(expected)
        steps += len(expected)
        run = run.cut()
    assert bits(run.stream.finish()) == bits(straight.stream.finish())
    assert run.outcome() == straight.outcome()
    assert steps > 200


@pytest.mark.parametrize('method', METHODS)
def test_cut_once_and_on_to_the_end(
        method: str, events: list[Event], repository: Path) -> None:
    made = settings(repository, method)
    run, runs, estimates = Run(made), [], []
    for number, event in enumerate(events):
        if number % 71 == 13:
            runs.append((number, len(estimates), run.cut()))
        estimates += run.take(event)
    estimates += run.stream.finish()
    expected = run.outcome()
    for number, count, other in runs:
        found = [e for event in events[number:] for e in other.take(event)]
        assert bits(found + other.stream.finish()) == bits(estimates[count:])
        assert other.outcome() == expected


def with_faults(events: list[Event], seed: int) -> list[Action]:
    """Return the events of a bad day: lost, late, twice, far ahead, far back, wild, unsound."""
    chance = random.Random(seed)
    actions: list[Action] = []
    late: list[tuple[int, Event]] = []
    for number, event in enumerate(events):
        while late and late[0][0] <= number:
            actions.append(late.pop(0)[1])
        if 100 <= number < 130:  # more than max_gap
            continue
        # and in the end time goes back
        event = Event(event.time - (4_000_000_000 if number >= 300 else 0), event.samples)
        if 200 <= number < 240 and event.samples[0].input == 'depth':
            late.append((number + 20, event))
        else:
            actions += fault(event, chance)
    return actions


def fault(event: Event, chance: random.Random) -> list[Action]:
    """Return what becomes of an event; most are as they were."""
    draw = chance.random()
    if draw < 0.03:
        return [event, event]
    if draw < 0.04:
        return [Event(event.time + chance.choice([-1, 1]) * 10**10, event.samples)]
    if draw < 0.07:
        return [Event(event.time, tuple([Sample(s.input, tuple([chance.choice([
            x, 30.0 * x, float('nan'), float('inf'), -0.0]) for x in s.value]), s.part)
            for s in event.samples]))]
    if draw < 0.08:
        return [chance.choice(['reset', 'disable', 'enable', 'enable', 'enable'])]
    return [event]


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('seed', range(3))
def test_cut_on_a_bad_day(
        method: str, seed: int, events: list[Event], repository: Path) -> None:
    actions = with_faults(events, seed)
    made = settings(repository, method, reset_on_time_jump=seed % 2 == 0)
    cuts = sorted(random.Random(seed).sample(range(len(actions)), 25))
    straight, run = Run(made), Run(made)
    for number, action in enumerate(actions):
        assert bits(run.take(action)) == bits(straight.take(action))
        if number in cuts:
            run = run.cut()
    assert bits(run.stream.finish()) == bits(straight.stream.finish())
    assert {'late', 'duplicate', 'backward', 'non_finite', 'gap'} <= {
        reason for _, reason in straight.stream.rejected}
    assert any('time jumped' in line for line in straight.stream._warnings)
    assert run.outcome() == straight.outcome()


@pytest.fixture(scope='module')
def states(events: list[Event], repository: Path) -> list[tuple[Settings, str]]:
    """Return states of every method, in the middle of a bad day."""
    found = []
    for method in METHODS:
        run = Run(settings(repository, method))
        for action in with_faults(events, 1)[:250]:
            run.take(action)
        found.append((run.stream.settings, run.text()))
    return Few(found)


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every container and key in a document."""
    keys: Any = node.keys() if isinstance(node, dict) else range(
        len(node)) if isinstance(node, list) else ()
    for key in keys:
        yield node, key
        yield from places(node[key])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=9)
    | st.sampled_from(['rovid_core.stream.Stream', 'rovid_core.motion.Motion', 'os.system']),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(['list', 'dict', 'deque', 'set', 'object', 'value', 'kept', 'same',
                         'shared', 'array', 'ndarray', 'scalar', 'float', 'x']),
        inner, max_size=2), max_leaves=6)


def damaged(data: st.DataObject, text: str, times: int = 3) -> Any:
    """Return a document in which something was dropped, put in or put in another place."""
    root = [json.loads(text)]
    for _ in range(data.draw(st.integers(1, times))):
        every = list(places(root))
        container, key = every[data.draw(st.integers(0, len(every) - 1))]
        change = data.draw(st.sampled_from(['put', 'drop', 'copy']))
        if change == 'drop' and container is not root:
            del container[key]
        elif change == 'copy':
            other, there = every[data.draw(st.integers(0, len(every) - 1))]
            container[key] = json.loads(json.dumps(other[there]))
        else:
            container[key] = data.draw(JSON)
    return root[0]


HOSTILE = hypothesis_settings(  # what to shrink is the whole state of a run: that takes for ever
    max_examples=80, deadline=None, phases=[Phase.generate],
    suppress_health_check=list(HealthCheck))


@HOSTILE
@given(data=st.data())
def test_a_damaged_snapshot_is_refused_or_put_back(
        data: st.DataObject, states: list[tuple[Settings, str]]) -> None:
    made, text = states[data.draw(st.integers(0, len(states) - 1))]
    run = Run(made)
    run.snapshots.put_back(json.loads(text))
    try:
        run.snapshots.put_back(damaged(data, text))
    except SnapshotError:
        assert run.text() == text  # all or nothing


@HOSTILE
@given(data=st.data())
def test_a_damaged_identifier_state_is_refused_or_works(
        data: st.DataObject, repository: Path, events: list[Event]) -> None:
    run = Run(settings(repository, data.draw(st.sampled_from(METHODS))))
    for event in events[:data.draw(st.sampled_from([0, 60, 330]))]:
        run.take(event)
    before = json.dumps(run.stream.state())
    try:
        run.stream.restore(damaged(data, before))
    except ValueError:
        assert json.dumps(run.stream.state()) == before
    else:
        for event in events[330:]:
            run.take(event)
        json.dumps(run.stream.state(), allow_nan=False)
