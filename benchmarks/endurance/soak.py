"""
Run for long.

``python -m benchmarks.endurance.soak [--hours H | --live S]``

Without ``--live``, H hours of a simulated vehicle with ten times the sensor rates go through
the live pipe, message by message: converter, stream, output messages; and what came of it is
printed. With ``--live``, the node runs in a process of its own for S seconds and
hears sensors at 50 Hz over DDS.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.queues import Queue
import os
from queue import Empty

from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.messages.converter import Converter
from rovid_ros.results.outputs import Outputs

from benchmarks.endurance.soak_outcome import Soak
from test.support.processes import resident
from test.support.sensors import built, sensed, times_faster
from test.support.trials import CONFIG

FASTER = 10.0
"""Times the sensor rates of the shipped configuration."""

METHODS = ('ekf', 'aid')


def simulated(method: str, hours: float, samples: int = 200) -> Iterator[Soak]:
    """
    Let a vehicle run through the pipe, as the node does it, in one process.

    Yields
    ------
    Soak
        After every hour, and in the end.

    """
    settings = _settings()
    settings = replace(settings, identifier=replace(settings.identifier, method=method))
    stream = Stream(settings)
    converter = Converter(settings, stream.reject)
    outputs = Outputs(settings)
    duration = 3600.0 * hours
    memory: list[tuple[float, int]] = []

    def soak(time: float) -> Soak:
        assert stream.estimate is not None
        # two measurements make the first velocity, which the filters start from
        missed = [stream.inputs[settings.source(dof.dof)].count - 2 - dof.steps
                  for dof in stream.estimate.dofs]
        return Soak(
            f'{time / 3600.0:.3g} h of simulated time, {method}', time,
            [*memory, (time, resident())], sum(dof.steps for dof in stream.estimate.dofs),
            sum(missed),
            {f'{name}.{reason}': count for (name, reason), count in stream.rejected.items()},
            {dof.dof: dof.parameters for dof in stream.estimate.dofs})

    begin, due, hour = 0, 0.0, 3600.0
    count = 0
    for message in sensed(settings, duration):
        begin = begin or message.time
        for event in converter.events(message.topic, built(message), message.time):
            for estimate in stream.receive(event):
                count += 1
                if not count % round(FASTER):  # published as often as the sensors usually come
                    outputs.messages(estimate)
        time = (message.time - begin) * 1e-9
        if time >= due:
            memory.append((time, resident()))
            due += duration / samples
        if time >= hour and hour < duration:
            yield soak(hour)
            hour += 3600.0
    stream.finish()
    yield soak(duration)


def _tell(method: str, hours: float, told: Queue[tuple[str, Soak]]) -> None:
    for soak in simulated(method, hours):
        told.put((method, soak))


def _settings() -> Settings:
    return times_faster(settings_from(load(CONFIG / 'jhurov.yaml')), FASTER)


def main() -> None:
    """Run, and print or write what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hours', type=float, default=24.0, help='simulated time, default: 24')
    parser.add_argument('--methods', nargs='+', default=METHODS, choices=METHODS,
                        help='of the simulated time, one process each')
    parser.add_argument('--live', type=float, metavar='S', help='seconds of the node on DDS')
    given = parser.parse_args()
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    if given.live:
        from benchmarks.endurance.soak_live import live, RATE
        soak = live(given.live)
        _print(f'The node on DDS, {RATE:g} Hz', soak)
        return
    context = get_context('spawn')
    told: Queue[tuple[str, Soak]] = context.Queue()
    runs = [context.Process(target=_tell, args=(method, given.hours, told), daemon=True)
            for method in given.methods]
    for run in runs:
        run.start()
    while any(run.is_alive() for run in runs) or not told.empty():
        try:
            method, soak = told.get(timeout=1.0)
        except Empty:
            continue
        if soak.duration == 3600.0 * given.hours:
            _print(f'Simulated time, ten times the sensor rates, {method}', soak)
    if any(run.exitcode for run in runs):
        raise SystemExit('a run failed')


def _print(title: str, soak: Soak) -> None:
    print(f'**{title}**', '', *soak.lines(_settings()), sep='\n', flush=True)


if __name__ == '__main__':
    main()
