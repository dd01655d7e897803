"""A stream's state that was damaged is refused, all of it, or it works."""

from collections.abc import Iterator
from dataclasses import replace
import json
from pathlib import Path
from typing import Any

from hypothesis import given, HealthCheck, Phase, settings as hypothesis_settings, strategies as st
import pytest
from rovid_core.model.samples import Event
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.messages.converter import Converter

from test.support.surge import HEAVY, LIGHT, run, surge_log, surge_settings

METHODS = ('aid', 'ekf')


class Events(list[Event]):
    """Events of which a failing test does not print thousands."""

    def __repr__(self) -> str:
        return f'{len(self)} events'


def settings(repository: Path, method: str) -> Settings:
    """Return the settings of a vehicle with three DOFs and slow sensors."""
    return settings_from({
        **load(repository / 'config' / 'jhurov.yaml'), 'identifier.method': method,
        'simulation.position_rate': 4.0, 'simulation.depth_rate': 3.0,
        'simulation.attitude_rate': 5.0, 'simulation.thruster_rate': 4.0, 'max_wait': 0.5})


@pytest.fixture(scope='module')
def events(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Event]:
    """Return the events of 26 s."""
    path = tmp_path_factory.mktemp('log') / 'log.mcap'
    made = settings(repository, 'aid')
    simulate_log(made, path, 26.0, seed=3)
    converter = Converter(made, lambda *refused: pytest.fail(str(refused)))
    with Log([path]) as log:
        found = Events(event for m in log.messages(list(converter.topics))
                       for event in converter.events(m.topic, m.data, m.time))
    assert len(found) > 400
    return found


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every container and key in a document."""
    keys: Any = node.keys() if isinstance(node, dict) else range(
        len(node)) if isinstance(node, list) else ()
    for key in keys:
        yield node, key
        yield from places(node[key])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(['dofs', 'terms', 'version', 'method', 'adapt', 'x']), inner,
        max_size=2), max_leaves=6)


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


HOSTILE = hypothesis_settings(  # to shrink a whole state takes for ever
    max_examples=50, deadline=None, phases=[Phase.generate],
    suppress_health_check=list(HealthCheck))


@pytest.mark.long
@HOSTILE
@given(data=st.data())
def test_a_damaged_state_is_refused_or_works(
        data: st.DataObject, repository: Path, events: list[Event]) -> None:
    stream = Stream(settings(repository, data.draw(st.sampled_from(METHODS))))
    for event in events[:data.draw(st.sampled_from([0, 60, 330]))]:
        stream.receive(event)
    before = json.dumps(stream.state())
    try:
        stream.restore(damaged(data, before))
    except ValueError:
        assert json.dumps(stream.state()) == before
    else:
        for event in events[330:400]:
            stream.receive(event)
        json.dumps(stream.state(), allow_nan=False)


def two_dofs(method: str) -> Settings:
    return replace(surge_settings(method=method), dofs=('surge', 'sway'),
                   dof={'surge': HEAVY, 'sway': LIGHT})


@pytest.mark.parametrize('method', METHODS)
def test_a_state_is_restored_whole_or_not_at_all(method: str) -> None:
    """What is wrong with the last DOF leaves also the first one as it was."""
    learned = Stream(two_dofs(method))
    run(learned, surge_log(1, 6.0))
    learned.enable(False)
    state = learned.state()
    other = Stream(two_dofs(method))
    run(other, surge_log(2, 4.0))
    before = json.dumps(other.state()), other.estimate
    for key in ('parameters', 'v_hat', 'excitation'):
        last = {**state['dofs']['sway'], key: 'x'}
        with pytest.raises(ValueError, match='sway'):
            other.restore({**state, 'dofs': {**state['dofs'], 'sway': last}})
        assert (json.dumps(other.state()), other.estimate) == before
        assert other.adapting
    other.restore(state)
    assert json.dumps(other.state()) == json.dumps(state)
    assert not other.adapting
