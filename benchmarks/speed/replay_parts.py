"""
What the parts of a replay take.

``python -m benchmarks.speed.replay_parts LOG.mcap PARAMS.yaml``
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
import sys
from time import process_time
from typing import Any

from rovid_core.model.samples import Event
from rovid_core.ordering.event_order import EventOrder
from rovid_core.pipeline.steps import Pipeline
from rovid_core.settings.run import Settings
from rovid_core.trials.score import ScoreLog
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.logs.player import PipelinePlayer

DURATION = 120.0  # [s] of the log
RUNS = 5


def parts(path: Path, settings: Settings) -> dict[str, float]:
    """Return the processor time of each part, and of those before it [s]."""
    found: dict[str, float] = {}

    def timed(name: str, work: Callable[[], Any]) -> Any:
        began = process_time()
        result = work()
        found[name] = process_time() - began
        return result

    player = PipelinePlayer(settings)
    with Log([path]) as log:
        topics = {name: name for name in player.converter.topics}
        timed('read', lambda: sum(1 for _ in log.raw(topics, 0.0, DURATION)))
        messages = timed('read, and unpack to events',
                         lambda: list(log.messages(topics, 0.0, DURATION, player.maker)))
    events = [event for message in messages for event in message.data]
    released = timed('put in order', lambda: _ordered(settings, events))
    moving = _pipeline(settings)
    for dof in moving.dofs:
        dof.add_step = lambda *_: None  # type: ignore[method-assign]
    timed('gates, velocity and thrust', lambda: _fed(moving, released))
    timed('gates, velocity, thrust and identifiers', lambda: _fed(_pipeline(settings), released))
    scored = Pipeline(settings, _ignore, _ignore, _ignore, ScoreLog(settings))
    timed('the pipeline with the score', lambda: _fed(scored, released))
    whole = PipelinePlayer(settings)

    def replay() -> None:
        for message in messages:
            whole.add_message(message)

    timed('order and pipeline as a replay runs them', replay)
    return {name: seconds / len(messages) for name, seconds in found.items()}


def _ordered(settings: Settings, events: Iterable[Event]) -> list[Event]:
    keys = [(name, 0) for name in settings.used_inputs()]
    order = EventOrder(keys, settings.wait, settings.time_jump, _ignore, _ignore,
                       settings.max_wait < 0.0)
    return [one for event in events for one in order.push(event)[0]] + order.flush()


def _pipeline(settings: Settings) -> Pipeline:
    return Pipeline(settings, _ignore, _ignore, _ignore)


def _fed(pipeline: Pipeline, events: Iterable[Event]) -> None:
    for event in events:
        for sample in event.samples:
            pipeline.add_sample(event.time, sample)


def _ignore(*_: str) -> None:
    """Take a refusal or a warning."""


def main() -> None:
    """Print the table."""
    settings = settings_from(load(Path(sys.argv[2])))
    runs = [parts(Path(sys.argv[1]), settings) for _ in range(RUNS)]
    print(f'The parts, least of {RUNS} runs of {DURATION:.0f} s in one process:\n\n'
          '| part | processor time per message [us] |\n|---|---|')
    for name in runs[0]:
        print(f'| {name} | {1e6 * min(run[name] for run in runs):.1f} |')


if __name__ == '__main__':
    main()
