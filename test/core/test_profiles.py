"""Thrust profiles: the waveforms, their text, the thrusters' limits, and several trials."""

from dataclasses import replace
import math
from pathlib import Path

from hypothesis import given, settings as hypothesis_settings, strategies as st
import numpy as np
import pytest
from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import Settings, SettingsError, SimulatedDof, ThrusterSettings
from rovid_core.simulation.profiles import Multisine, ProfileError, Sinusoid, Steps, Waveform
from rovid_core.simulation.sensors import simulate
from rovid_core.simulation.vehicle import profile_of, shortfall, ThrusterCommands
from rovid_core.thrust.thruster_curve import wrench
from rovid_ros.commands.main import main
from rovid_ros.commands.profile_text import GRAMMAR, parse_profile, profile_text
from rovid_ros.commands.simulate import plan_trials, profile_warnings
from rovid_ros.logs.log import Log, LogMessage

from test.support.surge import surge_settings


def sampled(waveform: Waveform, duration: float, rate: float) -> np.ndarray:
    return np.array([waveform.at(i / rate) for i in range(round(duration * rate))])


def test_a_sinusoid_starts_at_zero_and_peaks_after_a_quarter() -> None:
    wave = Sinusoid(120.0, 0.25)
    assert [wave.at(t) for t in (0.0, 1.0, 2.0, 3.0)] == pytest.approx([0, 120, 0, -120])


@pytest.mark.parametrize('wave', [
    Multisine(120.0, 0.02, 0.24, 12), Multisine(120.0, 0.02, 0.2, 12),
    Multisine(80.0, 0.01, 0.2, 20), Multisine(-5.0, 0.05, 0.3, 6), Multisine(1.0, 0.1, 1.0, 100)])
def test_a_multisine_is_even_and_within_its_amplitude(wave: Multisine) -> None:
    u = sampled(wave, 1100.0, 10.0 * wave.high)
    peak, rms = np.abs(u).max(), math.sqrt(float(np.mean(u ** 2)))
    assert 0.9 * abs(wave.amplitude) < peak <= 1.004 * abs(wave.amplitude)
    assert peak / rms < 2.02  # in phase: sqrt(2 lines), 3.5 to 14


def test_many_harmonics_have_a_crest_factor_below_1_8() -> None:
    u = sampled(Multisine(1.0, 0.01, 0.2, 20), 100.0, 20.0)
    assert np.abs(u).max() / math.sqrt(float(np.mean(u ** 2))) < 1.8


def test_a_multisine_has_its_lines_and_no_others() -> None:
    wave = Multisine(120.0, 0.02, 0.24, 12)
    duration, rate = 50.0, 4.0
    spectrum = np.fft.rfft(sampled(wave, duration, rate)) / (duration * rate / 2.0)
    lines = {round(f * duration): p for f, p in zip(wave.frequencies, wave.phases)}
    assert sorted(lines) == list(range(1, 13))
    for i, value in enumerate(spectrum):
        line = wave.line_amplitude * np.exp(1j * lines[i]) if i in lines else 0.0
        assert value == pytest.approx(line, abs=1e-9 * 120.0)


def test_the_phases_are_schroeder_s() -> None:
    # for a flat spectrum: phi_n = phi_1 - pi n (n - 1) / N, n from 1
    wave = Multisine(1.0, 0.1, 0.5, 5)
    assert wave.phases == pytest.approx([-math.pi * n * (n - 1) / 5 for n in range(1, 6)])


def test_steps_hold_each_level_and_begin_again() -> None:
    steps = Steps((100.0, 50.0, 0.0), 20.0)
    assert [steps.at(t) for t in (0.0, 19.9, 20.0, 40.0, 59.9, 60.0, 85.0)] == [
        100, 100, 50, 0, 0, 100, 50]
    # a command's time is a whole number of nanoseconds; none comes one sample late
    steps = Steps((1.0, -1.0), 0.35)
    assert [steps.at(i * 50_000_000 * 1e-9) for i in range(7000)] == [
        (1.0, -1.0)[i // 7 % 2] for i in range(7000)]


POSITIVE = st.floats(1e-6, 1e6)
LEVEL = st.floats(-1e9, 1e9)
WAVES = st.one_of(
    st.builds(Sinusoid, LEVEL, POSITIVE),
    st.builds(lambda a, low, band, n: Multisine(a, low, low + band, n),
              LEVEL, POSITIVE, POSITIVE, st.integers(2, 100)),
    st.builds(Steps, st.lists(LEVEL, min_size=2, max_size=5).map(tuple), POSITIVE))


@hypothesis_settings(max_examples=200, deadline=None)
@given(st.dictionaries(
    st.sampled_from(DOFS), st.lists(WAVES, max_size=3).map(tuple), min_size=1))
def test_a_profile_comes_back_from_its_text(profile: dict[str, tuple[Waveform, ...]]) -> None:
    assert parse_profile(profile_text(profile)) == profile


@pytest.mark.parametrize(('text', 'profile'), [
    ('surge=120@0.083', {'surge': (Sinusoid(120, 0.083),)}),
    ('surge=120@0.083 + 6e+1@4e-2, yaw=-20@.05',
     {'surge': (Sinusoid(120, 0.083), Sinusoid(60, 0.04)), 'yaw': (Sinusoid(-20, 0.05),)}),
    ('surge=multisine:120@0.02-0.2x12', {'surge': (Multisine(120, 0.02, 0.2, 12),)}),
    ('surge=steps:100@20', {'surge': (Steps((100, -100), 20),)}),
    ('heave=steps:+100/50/-1@20+5@1', {'heave': (Steps((100, 50, -1), 20), Sinusoid(5, 1))}),
    ('surge=0,yaw=0.0', {'surge': (), 'yaw': ()}),
])
def test_a_profile_is_read(text: str, profile: object) -> None:
    assert parse_profile(text) == profile


def test_the_examples_of_the_help_are_read() -> None:
    examples = [line.split()[0] for line in GRAMMAR.splitlines() if line.startswith('  surge')]
    assert len(examples) == 7
    for example in examples:
        assert profile_text(parse_profile(example)) == example


@pytest.mark.parametrize(('text', 'says'), [
    ('srge=1@1', 'did you mean surge'), ('surge', "'' for surge, takes"),
    ('', 'takes surge, sway'),
    ('surge=1', "'1' for surge, takes AMPLITUDE@FREQUENCY"), ('surge=1@', "'1@' for surge"),
    ('surge=1@1@1', "'1@1@1'"), ('surge=x@1', "'x@1'"), ('surge=nan@1', "'nan@1'"),
    ('surge=1@-1', "'1@-1'"), ('surge=1@0', 'above 0 Hz; takes AMPLITUDE@FREQUENCY'),
    ('surge=1@1,surge=2@2', 'names surge twice'), ('surge=1@1+', "'' for surge"),
    ('surge=1e999@1', 'has to be finite'), ('surge=0+1@1', "'0' for surge"),
    ('surge=multisin:1@1-2x3', 'did you mean multisine'),
    ('surge=saw:1@1', 'takes 120@0.083, multisine'),
    ('surge=multisine:1@1', 'takes multisine:AMPLITUDE@LOW-HIGHxLINES such as'),
    ('surge=multisine:1@2-1x3', 'end higher; takes multisine:'),
    ('surge=multisine:1@0-1x3', 'begin above 0 Hz'), ('surge=multisine:1@1-2x1', '2 to 100 lines'),
    ('surge=multisine:1@1-2x999999999', '2 to 100 lines'),
    ('surge=steps:1', 'takes steps:LEVEL@SECONDS such as steps:100@20'),
    ('surge=steps:1/@2', "'steps:1/@2'"), ('surge=steps:1@0', 'above 0 s; takes steps:'),
])
def test_a_profile_that_cannot_be_read_says_the_right_form(text: str, says: str) -> None:
    with pytest.raises(ProfileError) as caught:
        parse_profile(text)
    assert says in str(caught.value)
    assert '\n' not in str(caught.value)


def test_the_settings_sinusoids_move_what_is_not_named() -> None:
    truth = {'surge': SimulatedDof(1.0, forces=(5.0, 6.0), frequencies=(0.1, 0.0)),
             'yaw': SimulatedDof(1.0, forces=(7.0,), frequencies=(0.2,))}
    assert profile_of(truth) == {'surge': (Sinusoid(5.0, 0.1),), 'yaw': (Sinusoid(7.0, 0.2),)}
    assert profile_of(truth, {'yaw': (), 'sway': ()}) == {
        'surge': (Sinusoid(5.0, 0.1),), 'yaw': (), 'sway': ()}
    with pytest.raises(SettingsError, match=r'simulation\.sway\.mass'):
        profile_of(truth, {'sway': (Sinusoid(1.0, 1.0),)})


def test_a_dof_with_no_thrust_is_kept_still() -> None:
    # a sway thruster ahead of the middle turns the vehicle, unless the two aft ones hold it
    thrusters = ThrusterSettings(('/t',), gain=(40.0, 40.0, 40.0), allocation=(
        (1.0, 1.0, 0.0), (0.0, 0.0, 1.0), *[(0.0,) * 3] * 3, (0.25, -0.25, 0.5)))
    profile = {'sway': (Sinusoid(10.0, 0.25),)}
    turning = ThrusterCommands(thrusters, profile).at(1.0)
    still = ThrusterCommands(thrusters, {**profile, 'surge': (), 'yaw': (), 'heave': ()}).at(1.0)
    assert wrench(thrusters, turning) == pytest.approx((0, 10, 0, 0, 0, 5))
    assert wrench(thrusters, still) == pytest.approx((0, 10, 0, 0, 0, 0), abs=1e-12)
    # what the thrusters cannot hold stays as it is
    alone = replace(thrusters, gain=(0.0, 0.0, 40.0))
    assert wrench(alone, ThrusterCommands(alone, {**profile, 'yaw': ()}).at(1.0)) == (
        pytest.approx((0, 10, 0, 0, 0, 5)))


@pytest.fixture
def table() -> Settings:
    """Return a surge vehicle whose thruster gives -60 to 80 N."""
    s = surge_settings()
    return replace(s, thrusters=replace(
        s.thrusters, model='table', gain=(2.0,), table_command=(-1.0, 0.0, 1.0),
        table_force=(-30.0, 0.0, 40.0)))


def test_thrust_beyond_the_table_is_clipped_and_told(table: Settings) -> None:
    profile = {'surge': (Steps((50.0, 81.0, -40.0, -100.0), 1.0),)}
    short = shortfall(table.thrusters, profile, 20.0, 7.95)
    assert short is not None
    assert (short.dof, short.time, short.asked, short.given, short.share) == (
        'surge', 3.0, -100.0, -60.0, 0.5)
    (line,) = profile_warnings(table, 7.95, profile)
    assert '50 % of the time; at 3.00 s surge gets -60 of -100 N' in line
    commands = {v[0] for _, name, v in simulate(table, 4.0, 1, profile) if name == 'thrusters'}
    assert sorted(commands) == pytest.approx([-1.0, -2 / 3, 0.625, 1.0])
    assert profile_warnings(table, 8.0, {'surge': (Steps((80.0, -60.0), 1.0),)}) == []
    assert profile_warnings(surge_settings(), 8.0, {'surge': (Steps((1e6, -1e6), 1.0),)}) == []


@pytest.mark.parametrize(('model', 'most'), [('linear', 3.0), ('quadratic', 9.0)])
def test_thrusters_that_push_less_astern_are_asked_for_more(model: str, most: float) -> None:
    s = surge_settings()
    thrusters = replace(s.thrusters, model=model, gain=(1.0,), limit=3.0, reverse=0.5)
    profile = {'surge': (Steps((2.0, -1.0, -2.0), 1.0),)}
    commands = ThrusterCommands(thrusters, profile)
    assert commands.limits == [-0.5 * most, most]
    given = [wrench(thrusters, commands.at(t), ('surge',))[0] for t in (0.5, 1.5, 2.5)]
    assert given == pytest.approx([2.0, -1.0, max(-2.0, -0.5 * most)])
    short = shortfall(thrusters, {'surge': (Steps((1.0, -6.0), 1.0),)}, 20.0, 2.0)
    assert short is not None
    assert short.given == pytest.approx(-0.5 * most)


@pytest.mark.parametrize(('model', 'most'), [
    ('linear', 2.5), ('quadratic', 6.25), ('polynomial', 2.5 + 2.5**3), ('table', 40.0)])
def test_what_a_dead_zone_takes_is_commanded_besides(
        table: Settings, model: str, most: float) -> None:
    thrusters = replace(table.thrusters, model=model, gain=(1.0,), limit=3.0, dead_zone=0.5,
                        polynomial=(0.0, 1.0, 0.0, 1.0), table_force=(-40.0, 0.0, 40.0))
    commands = ThrusterCommands(thrusters, {'surge': (Steps((2.0, -1.0, 0.0, 99.0), 1.0),)})
    assert commands.limits == pytest.approx([-most, most])
    given = [wrench(thrusters, commands.at(t), ('surge',))[0] for t in (0.5, 1.5, 2.5, 3.5)]
    assert given == pytest.approx([2.0, -1.0, 0.0, most], rel=1e-4)
    assert commands.at(2.5) == (0.0,)


def test_of_a_very_long_profile_some_commands_tell_as_much(
        table: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    count, thrusters = 0, ThrusterCommands.thruster_forces

    def counted(self: ThrusterCommands, t: float) -> list[float]:
        nonlocal count
        count += 1
        return thrusters(self, t)

    monkeypatch.setattr(ThrusterCommands, 'thruster_forces', counted)
    short = shortfall(table.thrusters, {'surge': (Sinusoid(100.0, 0.1),)}, 20.0, 6000.0)
    assert short is not None
    assert (short.given, short.asked) == (-60.0, pytest.approx(-100.0))
    assert short.share == pytest.approx(0.5, abs=0.01)  # beyond 80 N, and below -60 N
    assert count < 50_000  # of 120,000 commands


def test_a_profile_faster_than_the_commands_is_told(table: Settings) -> None:
    (line,) = profile_warnings(table, 8.0, {'surge': (Sinusoid(1.0, 10.5),)})
    assert line == ('surge is to follow 10.5 Hz, more than half of the 20 Hz of '
                    'simulation.thruster_rate')
    assert profile_warnings(table, 8.0, {'surge': (Steps((1.0, -1.0), 0.05),)}) == []


@pytest.mark.parametrize(('output', 'count', 'names'), [
    ('out.mcap', 1, ['out.mcap']), ('a/out.mcap', 2, ['a/out-1.mcap', 'a/out-2.mcap']),
    ('a/{}.mcap', 2, ['a/1.mcap', 'a/2.mcap']), ('{n}/t{n}', 2, ['1/t1', '2/t2']),
    ('{}.mcap', 1, ['1.mcap']), ('out', 2, ['out-1', 'out-2']),
])
def test_trials_are_numbered(output: str, count: int, names: list[str]) -> None:
    trials = plan_trials(Path(output), 100.5, 7, [{}] * count)
    assert [str(trial.path) for trial in trials] == names
    assert [trial.seed for trial in trials] == list(range(7, 7 + count))
    for before, after in zip(trials, trials[1:]):
        assert after.start - before.start == 161_000_000_000


def messages(path: Path) -> tuple[dict[str, str], list[LogMessage]]:
    with Log([path]) as log:
        return log.metadata['rovid_truth'], list(log.messages(list(log.topics)))


def test_trials_are_repeatable_and_differ_in_noise(
        repository: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = str(repository / 'config' / 'jhurov.yaml')
    profiles = ['surge=steps:90@2,heave=0,yaw=0'] * 2 + ['surge=0,heave=0,yaw=multisine:9@0.1-1x5']
    arguments = ['--duration', '5', *[f'--profile={profile}' for profile in profiles]]
    for folder in ('a', 'b'):
        (tmp_path / folder).mkdir()
        assert main(['simulate', '--params-file', config, '--output',
                     str(tmp_path / folder / 't.mcap'), *arguments]) == 0
    assert capsys.readouterr().err == ''
    logs = sorted((tmp_path / 'a').iterdir())
    assert [log.name for log in logs] == ['t-1.mcap', 't-2.mcap', 't-3.mcap']
    for log in logs:
        assert log.read_bytes() == (tmp_path / 'b' / log.name).read_bytes()
    (truth, first), (_, second), (other, _) = map(messages, logs)
    assert [truth['profile'], other['profile']] == profiles[1:]
    assert [m.topic for m in first] == [m.topic for m in second]
    assert first[-1].time < second[0].time
    for a, b in zip(first, second):
        if a.topic == '/thrusters/current':
            assert list(a.data.effort) == list(b.data.effort)
        if a.topic == '/sharps/position':
            assert 0.0 < abs(a.data.point.x - b.data.point.x) < 0.05


@pytest.mark.parametrize(('output', 'says'), [
    ('t.mcap', 't-2.mcap: is a directory'), ('no/{}.mcap', 'the directory no does not exist')])
def test_a_trial_that_cannot_be_written_stops_all(
        output: str, says: str, repository: Path, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / 't-2.mcap').mkdir()
    assert main(['simulate', '--params-file', str(repository / 'config' / 'jhurov.yaml'),
                 '--output', output, '--profile', 'surge=1@1', '--profile', 'yaw=1@1']) == 1
    assert says in capsys.readouterr().err
    assert len(list(tmp_path.iterdir())) == 1


def test_a_trial_that_cannot_be_driven_stops_all(
        repository: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['simulate', '--params-file', str(repository / 'config' / 'jhurov.yaml'),
                 '--output', str(tmp_path / 't.mcap'), '--profile', 'surge=1@1',
                 '--profile', 'sway=1@1']) == 1
    assert 'simulation.sway.mass' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
