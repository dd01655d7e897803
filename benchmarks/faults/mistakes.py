"""
Tell whether the first warning names the key that is wrong in a configuration.

Each example of ``rovid simulate`` is simulated with its truth and read with the configuration of
its user, and the tank recordings with theirs, once as they are and once with each mistake. A cell
says in how many logs the first line of warnings names the right key, and the last row, in how many
a right configuration is accused of a mistake: of this there are more logs.

Usage: python -m benchmarks.faults.mistakes [RECORDINGS] [--seeds N] [--right N] [--duration S]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
import math
from pathlib import Path
import tempfile

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import IdentifierSettings, Settings
from rovid_core.simulation.sensors import simulate
from rovid_core.velocity.attitude_history import from_yaw
from rovid_ros.commands.examples import example_configuration, example_truth, EXAMPLES
from rovid_ros.config.parameter_file import load, shipped_file
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.messages.converter import Converter

from benchmarks.markdown import table

EPOCH = 1_700_000_000 * 1_000_000_000
TANK = ('all_axes', 'surge_sway_heave')
Change = Callable[[Settings], Settings]
Spoil = Callable[[Sample], Sample]


@dataclass(frozen=True)
class Mistake:
    """What is changed, and the keys of which the first warning has to name one."""

    name: str
    keys: tuple[str, ...]
    change: Change = lambda settings: settings
    spoil: Spoil = lambda sample: sample
    applies: Callable[[Settings], bool] = lambda settings: True


def _of(input: str, value: Callable[[tuple[float, ...]], tuple[float, ...]]) -> Spoil:
    return lambda sample: sample.replaced(
        value=value(sample.value)) if sample.input == input else sample


def _yaw(q: tuple[float, ...]) -> float:
    x, y, z, w = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _as_ned(sample: Sample) -> Sample:
    v = sample.value
    if sample.input == 'position':
        return sample.replaced(value=(v[1], v[0], -v[2]))
    if sample.input == 'attitude':
        h, (x, y, z, w) = math.sqrt(0.5), v
        return sample.replaced(value=(h * (x + y), h * (x - y), h * (w - z), h * (w + z)))
    return sample


def _allocation(change: Callable[[np.ndarray], None]) -> Change:
    def changed(settings: Settings) -> Settings:
        allocation = np.array(settings.thrusters.allocation)
        change(allocation)
        return replace(settings, thrusters=replace(
            settings.thrusters, allocation=tuple(map(tuple, allocation.tolist()))))
    return changed


def _exchange(allocation: np.ndarray) -> None:
    allocation[:, [0, 1]] = allocation[:, [1, 0]]


def _one_sign(allocation: np.ndarray) -> None:
    allocation[DOFS.index('sway'), np.flatnonzero(allocation[DOFS.index('sway')])[0]] *= -1.0


def _neutral(by: float) -> Change:
    return lambda s: replace(s, thrusters=replace(s.thrusters, offset=s.thrusters.offset + by))


def _pulses(settings: Settings) -> bool:
    return settings.thrusters.offset > 1000.0


MISTAKES = (
    Mistake('compass mirrored', ('attitude.heading',),
            spoil=_of('attitude', lambda q: from_yaw(-_yaw(q)))),
    Mistake('heading off by 90 degrees', ('attitude.yaw_offset',),
            spoil=_of('attitude', lambda q: from_yaw(_yaw(q) + 0.5 * math.pi))),
    Mistake('degrees read as radians', ('attitude.unit',),
            spoil=_of('attitude', lambda q: from_yaw(math.degrees(_yaw(q))))),
    Mistake('two thrusters exchanged', ('thrusters.allocation',), _allocation(_exchange)),
    Mistake('one sign of the allocation', ('thrusters.allocation',), _allocation(_one_sign)),
    Mistake('neutral 50 us too high', ('thrusters.offset',), _neutral(50.0), applies=_pulses),
    Mistake('neutral 50 us too low', ('thrusters.offset',), _neutral(-50.0), applies=_pulses),
    Mistake('messages in ned read as enu', ('frames',), spoil=_as_ned),
    Mistake('height counted downwards', ('depth.scale', 'row heave'), spoil=lambda sample: _of(
        'depth', lambda v: (-v[0],))(_of('position', lambda v: (v[0], v[1], -v[2]))(sample))),
    Mistake('thrust stamped 2 s early', ('thrusters.latency', 'thrusters.delay'),
            lambda s: replace(s, thrusters=replace(s.thrusters, latency=2.0))),
    Mistake('millimetres', ('position.field',), spoil=_of(
        'position', lambda v: tuple([1000.0 * x for x in v]))),
)
RIGHT = Mistake('a right configuration', tuple([key for m in MISTAKES for key in m.keys]))


def warnings(settings: Settings, events: list[Event], mistake: Mistake) -> list[str]:
    """Return what is told of a log with a mistake."""
    # the warnings do not depend on the method; this one is quick
    changed = mistake.change(replace(settings, identifier=IdentifierSettings('aid')))
    late = round((changed.thrusters.latency - settings.thrusters.latency) * 1e9)
    stream = Stream(changed)
    stream.take_warnings()
    for event in events:
        time = event.time - late * (event.samples[0].input == 'thrusters')
        stream.receive(Event(time, tuple(map(mistake.spoil, event.samples))))
    stream.finish()
    return stream.take_warnings()


def simulated(name: str, seed: int, duration: float | None) -> tuple[Settings, list[Event]]:
    """Return what the user of an example configured, and what its sensors measure."""
    example, truth = EXAMPLES[name], example_truth(name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'user.yaml'
        path.write_text(example_configuration(example))
        settings = settings_from(load(path))

    def off(input: str) -> int:
        latency = truth.thrusters.latency - settings.thrusters.latency if (
            input == 'thrusters') else truth.input(input).latency - settings.input(input).latency
        return round(latency * 1e9)
    events = [Event(EPOCH + time + off(input), (Sample(input, value),)) for time, input, value
              in simulate(truth, duration or example.duration, seed, example.profile)]
    return settings, events


def recorded(path: Path) -> tuple[Settings, list[Event]]:
    """Return the configuration of the tank, and a recording of it."""
    settings = settings_from(load(shipped_file('bluerov2_tank.yaml')))
    converter = Converter(settings, lambda name, reason: None)
    with Log([path]) as log:
        events = [event.replaced(origin=None)
                  for message in log.messages(converter.topics)
                  for event in converter.events(message.topic, message.data, message.time)]
    return settings, events


def logs(data: Path | None, seeds: int, right: int, duration: float | None
         ) -> Iterator[tuple[str, Settings, list[Event], tuple[Mistake, ...]]]:
    """Yield the name of a vehicle, its configuration, a log, and the mistakes to make."""
    both = (*MISTAKES, RIGHT)
    for name in EXAMPLES:
        for seed in range(1, max(seeds, right) + 1):
            yield (name, *simulated(name, seed, duration), both if seed <= seeds else (RIGHT,))
    for name in TANK if data else ():
        yield ('tank', *recorded(data / f'{name}.mcap'), both)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('data', nargs='?', type=Path, metavar='RECORDINGS')
    parser.add_argument('--seeds', type=int, default=2)
    parser.add_argument('--right', type=int, default=6, metavar='N',
                        help='logs of each example with a right configuration')
    parser.add_argument('--duration', type=float)
    args = parser.parse_args()
    counts: dict[tuple[str, str], list[int]] = {}
    for vehicle, settings, events, mistakes in logs(
            args.data, args.seeds, args.right, args.duration):
        for mistake in mistakes:
            if not mistake.applies(settings):
                continue
            told = warnings(settings, events, mistake)
            named = bool(told) and any(
                key in line for key in mistake.keys
                for line in (told if mistake is RIGHT else told[:1]))
            count = counts.setdefault((mistake.name, vehicle), [0, 0])
            count[0] += named
            count[1] += 1
    vehicles = list(dict.fromkeys(vehicle for _, vehicle in counts))

    def cell(of: list[int] | None) -> str:
        return '{} of {}'.format(*of) if of else '-'

    def total(names: list[str]) -> list[int]:
        own = [count for (name, _), count in counts.items() if name in names]
        return [sum(column) for column in zip(*own)]
    print(table(['', *vehicles, 'all'], [
        [name, *(cell(counts.get((name, vehicle))) for vehicle in vehicles), cell(total([name]))]
        for name in [m.name for m in (*MISTAKES, RIGHT)]]))
    print(f'\nNamed in the first line: {cell(total([m.name for m in MISTAKES]))}. '
          f'Right configurations accused: {cell(total([RIGHT.name]))}.')


if __name__ == '__main__':
    main()
