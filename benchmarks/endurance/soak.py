"""
Run for long.

``python -m benchmarks.endurance.soak [--hours H [--faster F] | --live S]``

Without ``--live``, H hours of a simulated vehicle with F times the sensor rates go through
the live pipe, message by message: converter, stream, output messages; and what came of it is
printed. With ``--live``, the node runs in a process of its own for S seconds and
hears sensors at 50 Hz over DDS.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
import os

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

METHODS = ('ekf', 'aid')


def simulated(method: str, hours: float, faster: float, samples: int = 200) -> Soak:
    """Let a vehicle run through the pipe, as the node does it, in one process."""
    settings = _settings(faster)
    settings = replace(settings, identifier=replace(settings.identifier, method=method))
    stream = Stream(settings)
    converter = Converter(settings, stream.reject)
    outputs = Outputs(settings)
    duration = 3600.0 * hours
    memory: list[tuple[float, int]] = []

    begin, due, count = 0, 0.0, 0
    for message in sensed(settings, duration):
        begin = begin or message.time
        for event in converter.events(message.topic, built(message), message.time):
            for estimate in stream.receive(event):
                count += 1
                if not count % round(faster):  # published as often as the sensors usually come
                    outputs.messages(estimate)
        time = (message.time - begin) * 1e-9
        if time >= due:
            memory.append((time, resident()))
            due += duration / samples
    stream.finish()
    assert stream.estimate is not None
    # two measurements make the first velocity, which the filters start from
    missed = [stream.inputs[settings.source(dof.dof)].count - 2 - dof.steps
              for dof in stream.estimate.dofs]
    return Soak(
        f'{duration / 3600.0:.3g} h of simulated time, {method}', duration,
        [*memory, (duration, resident())], sum(dof.steps for dof in stream.estimate.dofs),
        sum(missed),
        {f'{name}.{reason}': count for (name, reason), count in stream.rejected.items()},
        {dof.dof: dof.parameters for dof in stream.estimate.dofs})


def _settings(faster: float = 1.0) -> Settings:
    return times_faster(settings_from(load(CONFIG / 'jhurov.yaml')), faster)


def main() -> None:
    """Run, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hours', type=float, default=1.0, help='simulated time, default: 1')
    parser.add_argument('--faster', type=float, default=10.0,
                        help='times the sensor rates of the shipped configuration, default: 10')
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
    with ProcessPoolExecutor(len(given.methods), get_context('spawn')) as pool:  # each its own
        for method, soak in zip(given.methods, pool.map(
                simulated, given.methods, [given.hours] * len(given.methods),
                [given.faster] * len(given.methods))):
            _print(f'{given.faster:g} times the sensor rates, {method}', soak)


def _print(title: str, soak: Soak) -> None:
    print(f'**{title}**', '', *soak.lines(_settings()), sep='\n', flush=True)


if __name__ == '__main__':
    main()
