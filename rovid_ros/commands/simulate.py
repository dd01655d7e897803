"""``rovid simulate``: the log of a vehicle whose parameters are known."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import heapq
from itertools import chain, groupby
import math
from pathlib import Path
import re
import shlex
import struct
import textwrap

from rovid_core.model.dofs import ANGULAR_DOFS, PARAMETERS, PHYSICAL
from rovid_core.model.plant import lumped
from rovid_core.settings.run import Settings, SimulatedDof, SimulationSettings
from rovid_core.simulation.profiles import Profile, ProfileError
from rovid_core.simulation.sensors import Measurement, simulate
from rovid_core.simulation.vehicle import profile_of, shortfall
from rovid_ros.commands.arguments import add_params_file, duration, mcap, seed
from rovid_ros.commands.examples import example_configuration, example_truth, EXAMPLES
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.profile_text import GRAMMAR, parse_profile, profile_text
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    Interrupt,
    Interrupted,
    located_errors,
    read_settings,
    UsageError,
    warn,
)
from rovid_ros.files.whole_files import write_text
from rovid_ros.logs.writer import LogWriter, OutputLog, unfinished
from rovid_ros.messages.simulated_messages import SensorMessage, SensorMessages, SimulationError

# When every simulation begins [ns]: fixed, so that the same seed gives the same file.
EPOCH = 1_700_000_000 * 1_000_000_000

DESCRIPTION = (
    'Its parameters are those under "simulation" in the file; the log says them under the MCAP '
    'metadata rovid_truth. The same seed gives the same file.')

DURATION = 600.0  # [s]
NUMBER = re.compile(r'\{n?\}')  # where the number of a trial goes in the name of its file
# Between two trials of one call [ns]: joined into one log, they follow one another.
PAUSE = 60 * 1_000_000_000


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid simulate`` takes."""
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.description = textwrap.fill(str(command.description), 78)
    command.epilog = f'{_example_lines()}\n\n{GRAMMAR}'
    add_params_file(command, required=False)
    command.add_argument(
        '--example', choices=EXAMPLES, metavar='NAME',
        help='instead of a file: a vehicle that is not quite its model, as real ones are, with '
             'the log and the configuration that its user has; see below')
    command.add_argument(
        '--output', type=mcap, metavar='OUT.mcap',
        help="{} in the name is the trial's number, such as trials/{}.mcap; without it, several "
             'trials go to OUT-1.mcap, OUT-2.mcap, ... (default with --example: NAME.mcap)')
    command.add_argument('--duration', type=duration, metavar='S',
                         help='length of each trial [s] (default: 600, or that of the example)')
    command.add_argument(
        '--seed', type=seed, default=1, metavar='N',
        help='of the noise (default: 1); of several trials the first has N, the next N+1, ...')
    command.add_argument(
        '--profile', type=_profile, action='append', metavar='P',
        help='thrust of a trial, see below; each further --profile is another trial')


def run(args: argparse.Namespace) -> None:
    """Run ``rovid simulate``."""
    if args.example:
        _write_example(args)
        return
    if not args.params_file or not args.output:
        raise UsageError('takes --params-file FILE and --output OUT.mcap, or --example NAME')
    args.duration = args.duration or DURATION
    trials = plan_trials(args.output, args.duration, args.seed, args.profile or [{}])
    paths = [trial.path for trial in trials]
    check_written([*{*paths, *map(unfinished, paths)}], [*args.params_file.paths])
    settings = read_settings(args.params_file)
    with located_errors(args.params_file):
        warnings = [f'{trial.path}: {line}' for trial in trials
                    for line in profile_warnings(settings, args.duration, trial.profile)]
        for line in warnings:
            warn(args.prog, line)
        for trial in trials:
            count = simulate_log(
                settings, trial.path, args.duration, trial.seed, trial.profile, trial.start)
            print(f'{trial.path}: {args.duration:,.1f} s, {count:,} messages, seed {trial.seed}')
    does = 'identify it with: rovid replay' if len(paths) == 1 else 'compare them: rovid compare'
    print(f'{does} {" ".join(map(str, paths))} {shlex.join(args.params_file.arguments)}')


def _write_example(args: argparse.Namespace) -> None:
    """Write the log and the configuration of an example."""
    if args.params_file or args.profile:
        raise UsageError('--example takes no --params-file and no --profile')
    example = EXAMPLES[args.example]
    log = args.output or Path(f'{args.example}.mcap')
    configuration = log.with_suffix('.yaml')
    check_written([log, unfinished(log), configuration], [])
    text = example_configuration(example)
    if configuration.exists() and configuration.read_bytes() != text.encode():
        raise CommandError(f'{configuration}: is there, and is another configuration; give '
                           'another name with --output')
    length = args.duration or example.duration
    count = simulate_log(
        example_truth(args.example), log, length, args.seed, example.profile)
    write_text(configuration, text)
    print(f'{log}: {length:,.1f} s, {count:,} messages, seed {args.seed}: {example.summary}')
    print(f'{configuration}: what its user configured; the true parameters are in the metadata '
          f'rovid_truth of {log}')
    print(f'identify it with: rovid replay {log} --params-file {configuration}')


def _example_lines() -> str:
    return '\n'.join(['examples:', *(
        f'  {name:<10} {example.summary}' for name, example in EXAMPLES.items())])


def _profile(text: str) -> Profile:
    try:
        return parse_profile(text)
    except ProfileError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


@dataclass(frozen=True)
class Trial:
    """One log of several that are made in one call."""

    path: Path
    seed: int
    start: int  # [ns]
    profile: Profile


def plan_trials(output: Path, duration: float, seed: int,
                profiles: Sequence[Profile]) -> list[Trial]:
    """
    Lay out the trials of one call.

    Each starts a minute after the end of the one before, with a seed that is one higher. ``{}`` in
    the name of the output stands for the trial's number, from 1. Without it a single trial is
    written there, and of several ``out.mcap`` the first to ``out-1.mcap``.
    """
    name = str(output)
    if not NUMBER.search(name) and len(profiles) > 1:
        name = str(output.with_name(f'{output.stem}-{{}}{output.suffix}'))
    step = math.ceil(duration) * 1_000_000_000 + PAUSE
    return [Trial(Path(NUMBER.sub(str(k + 1), name)), seed + k, EPOCH + k * step, profile)
            for k, profile in enumerate(profiles)]


def profile_warnings(settings: Settings, duration: float, profile: Profile) -> list[str]:
    """
    Return what the thrusters cannot do of a trial's profile, one line each.

    Raises SettingsError if they cannot move what the profile moves.
    """
    lines = []
    rate = settings.simulation.thruster_rate
    profile = profile_of(settings.simulation.dofs, profile)
    for dof, waveforms in profile.items():
        highest = max([w.max_frequency for w in waveforms], default=0.0)
        if highest > 0.5 * rate:
            lines.append(f'{dof} is to follow {highest:g} Hz, more than half of the {rate:g} Hz '
                         'of simulation.thruster_rate')
    short = shortfall(settings.thrusters, profile, rate, duration)
    if short:
        unit = 'N m' if short.dof in ANGULAR_DOFS else 'N'
        lines.append(f'the thrusters are at their limit for {100.0 * short.share:.3g} % of the '
                     f'time; at {short.time:.2f} s {short.dof} gets {short.given:.4g} of '
                     f'{short.asked:.4g} {unit}')
    return lines


def simulate_log(settings: Settings, path: Path, duration: float, seed: int,
                 profile: Profile | None = None, start: int = EPOCH) -> int:
    """
    Write the log of a simulated vehicle and return how many messages it has.

    Topics and types are as configured. The log is ``duration`` [s] long, from ``start`` [ns]. It
    is NAME.part.mcap until it is finished.

    Parameters
    ----------
    settings : Settings
        With the truth, the sensor rates and the noise under ``simulation``.
    path : Path
        MCAP file; its metadata record ``rovid_truth`` holds the true parameters and, as
        ``profile``, the thrust of all DOFs.
    seed : int
        Of the noise; the same seed gives the same file, byte for byte.
    profile : mapping, optional
        Thrust per DOF; the others have that of the settings.

    Raises
    ------
    SimulationError, SettingsError
        If there is no truth to simulate, or a message type cannot be filled.

    """
    sensors = SensorMessages(settings)
    messages = _in_order(sensors, simulate(
        settings, duration, seed, profile, sensors.whole_commands), start)
    first = next(messages)  # what cannot be simulated shows before there is a file
    count, elapsed = 0, 0
    part = unfinished(path)
    with (Interrupt(part) as interrupt, OutputLog(path) as writer,
          Progress('simulate', lambda: elapsed / (duration * 1e9)) as progress):
        writer.metadata('rovid_truth', {
            **truth(settings.simulation.dofs), **current_truth(settings.simulation),
            'profile': profile_text(profile_of(settings.simulation.dofs, profile))})
        for message in chain([first], messages):
            if interrupt.asked:
                break
            _write(writer, message)
            count, elapsed = count + 1, message.time - start
            progress.tick()
    if interrupt.asked:
        raise Interrupted(
            f'interrupted; {part} holds the first {elapsed * 1e-9:.1f} s', interrupt.code)
    writer.finish()
    return count


def truth(simulated: Mapping[str, SimulatedDof]) -> dict[str, str]:
    """Return the true parameters, physical and lumped, as text by ``<dof>.<parameter>``."""
    values: dict[str, str] = {}
    for dof, true in simulated.items():
        physical = (true.mass, true.quadratic_drag, true.linear_drag, true.bias)
        for name, value in zip(PHYSICAL + PARAMETERS, physical + lumped(*physical)):
            values[f'{dof}.{name}'] = repr(float(value))
    return values


def current_truth(simulated: SimulationSettings) -> dict[str, str]:
    """Return the true current as text by ``current.<name>``, in the ENU world; {} if still."""
    if not any(simulated.current):
        return {}
    x, y = simulated.current
    return {'current.x': repr(x), 'current.y': repr(y),
            'current.turn': repr(simulated.current_turn),
            'current.tide': repr(simulated.current_tide)}


def _write(writer: LogWriter, message: SensorMessage) -> None:
    try:
        writer.write(message.topic, message.type, message.fields, message.time)
    except (OverflowError, struct.error) as error:
        raise SimulationError(
            message.topic, f'a value does not fit the integer in {message.type}: {error}'
        ) from None


def _in_order(sensors: SensorMessages, samples: Iterator[Measurement],
              start: int) -> Iterator[SensorMessage]:
    """Yield the messages in the order of arrival: each is as late as its input's latency."""
    waiting: list[tuple[int, int, SensorMessage]] = []
    count = 0
    for time, group in groupby(samples, key=lambda sample: sample[0]):
        now = start + time
        while waiting and waiting[0][0] <= now + sensors.soonest:
            yield heapq.heappop(waiting)[2]
        for message in sensors.messages(now, {name: value for _, name, value in group}):
            heapq.heappush(waiting, (message.time, count, message))
            count += 1
    while waiting:
        yield heapq.heappop(waiting)[2]
