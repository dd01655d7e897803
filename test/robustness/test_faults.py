"""Some faults of the campaign: each is said, nothing breaks, and the model recovers."""

from pathlib import Path
import re

import pytest

from test.support.fault_cases import BY_NAME, Fault, FAULTS
from test.support.fault_edits import Messages, Recording
from test.support.fault_outcomes import Outcome
from test.support.fault_runs import Bench, replayed, simulated, tank

pytestmark = pytest.mark.long

HARD = ['position silent 10 s', 'attitude silent 10 s', 'thrusters silent 10 s', 'outliers 5 %',
        'fix jumps by 2 m', 'a name missing', 'position in bursts', 'position 1 h ahead',
        'clocks back 1 h']
SENSELESS = ['position nan', 'thrusters 1e300', 'quaternion of zeros']  # refused at the door
HARMLESS = ['quaternion -q', 'out of order by 50 ms', 'everything in bursts']


@pytest.fixture(scope='module')
def bench() -> Bench:
    return simulated(90.0, 25.0, depth=10.0, attitude=10.0, thruster=10.0)


def at_once(recording: Recording, faults: list[Fault]) -> Messages:
    """Return messages with several faults."""
    for fault in faults:
        messages = fault.edit(recording, fault.span(recording))
        recording = Recording(recording.settings, messages, recording.on)
    return recording.messages


def suffered(bench: Bench, faults: list[Fault]) -> tuple[Outcome, str]:
    """Return what comes of faults at once, and what is said that is not said without them."""
    settings = bench.method('ekf')
    outcome = replayed(at_once(bench.recording, faults), settings)
    refused, said = outcome.beyond(bench.usual(settings), faults[0].span(bench.recording))
    return outcome, '\n'.join([*refused, *said])


def test_the_faults_are_many_and_each_has_its_name() -> None:
    assert sum(map(len, FAULTS.values())) == len(BY_NAME) > 40


@pytest.mark.parametrize('names', [*[[name] for name in HARD], SENSELESS], ids=', '.join)
def test_a_fault_is_said_and_got_over(names: list[str], bench: Bench) -> None:
    faults = [BY_NAME[name] for name in names]
    outcome, said = suffered(bench, faults)
    assert not outcome.failed
    assert not outcome.not_finite
    assert all(re.search(fault.says, said) for fault in faults)
    usual = bench.usual(bench.method('ekf'))
    assert bench.ratio(outcome, usual)[0] < 1.2
    assert bench.off(outcome) < 0.02  # the ratio is mostly that of the noise


@pytest.mark.parametrize('name', HARMLESS)
def test_what_is_harmless_changes_nothing(name: str, bench: Bench) -> None:
    outcome, said = suffered(bench, [BY_NAME[name]])
    usual = bench.usual(bench.method('ekf'))
    assert said == ''
    assert outcome.rejected == usual.rejected
    if name != 'quaternion -q':  # the signs of some zeros differ
        assert outcome.steps == usual.steps
    for dof, model in usual.models.items():
        assert outcome.models[dof] == pytest.approx(model, rel=1e-9)


def test_faults_in_the_tank(data: Path) -> None:
    """Three at once: each is said, and together they are got over."""
    bench = tank(data / 'bluerov2_tank')
    settings = bench.method('aid')  # what it costs the filter: above
    faults = [BY_NAME[name] for name in ('outliers 5 %', 'thrusters nan', 'messages cut short')]
    outcome = replayed(at_once(bench.recording, faults), settings)
    refused, said = outcome.beyond(bench.usual(settings), faults[0].span(bench.recording))
    assert not outcome.failed
    for fault in faults:
        assert re.search(fault.says, '\n'.join([*refused, *said]))
    assert bench.ratio(outcome, bench.usual(settings))[0] < 1.2


def test_live_gives_the_steps_of_a_replay() -> None:
    pytest.importorskip('rclpy')
    from test.support.fault_live import live, WAIT
    short = simulated(30.0, 8.0)
    faults = [BY_NAME[name] for name in ('thrusters nan', 'everything twice', 'random bytes')]
    messages = at_once(short.recording, faults)
    expected = replayed(messages, short.method('ekf', WAIT))
    outcome = live(messages, short, expected)
    assert not outcome.failed
    assert not outcome.not_finite
    assert len(outcome.steps) > 500
    assert outcome.steps == expected.steps
    for fault in faults:
        assert re.search(fault.says, '\n'.join([*outcome.rejected, *outcome.warnings]))
