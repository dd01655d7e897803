"""A configuration against a recorded log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rovid_core.settings.run import Settings
from rovid_ros.commands.check.data import check_data, Observation
from rovid_ros.commands.check.findings import Findings
from rovid_ros.commands.progress import Progress
from rovid_ros.config.input_topics import inputs_of, section
from rovid_ros.logs.log import Log, LogError
from rovid_ros.messages.convert import Converter
from rovid_ros.messages.field_paths import FieldError, nearest
from rovid_ros.messages.types import normalised


def check_log(paths: Sequence[Path], settings: Settings, findings: Findings,
              start: float = 0.0, duration: float | None = None) -> Observation | None:
    """
    Read a log once and say how it fits.

    Parameters
    ----------
    paths : sequence of Path
        Logs, joined in time order.
    settings : Settings
        The run.
    findings : Findings
        Told what is found.
    start, duration : float
        Part of the log to use [s], from its beginning.

    Returns
    -------
    seen : Observation or None
        What the messages say; None if the log cannot be read.

    """
    try:
        with Log(paths) as log:
            seen = Observation(settings)
            topics = _topics(log, seen.converter, settings, findings)
            with Progress('check', lambda: log.progress) as progress:
                for message in log.messages(topics, start, duration):
                    seen.take(topics[message.topic], message.data, message.time)
                    progress.tick()
            seen.finish()
            for line in log.warnings:
                findings.warning('log', line)
    except (LogError, FieldError) as error:
        findings.error('log', str(error))
        return None
    check_data(seen, findings)
    return seen


def _topics(log: Log, converter: Converter, settings: Settings, findings: Findings
            ) -> dict[str, str]:
    """Return the topics that can be read: the log's name to the configured one."""
    there = sorted(name for name, info in log.topics.items() if info.count != 0)
    readable = {}
    for topic, type_name in converter.topics.items():
        name = f'/{topic.lstrip("/")}'
        inputs = inputs_of(settings, topic)
        key = section(inputs[0])
        if name not in there:
            report = findings.warning if inputs == ['reference'] else findings.error
            report(f'{key}.topic', f'no messages on {name}{_hint(log, name, type_name, there)}',
                   f'the log has {", ".join(there[:12])}{" ..." if len(there) > 12 else ""}')
            continue
        found = log.topics[name]
        if type_name and normalised(type_name) != found.type:
            findings.error(f'{key}.type', f'{name} is {found.type}, not {type_name}',
                           f'write {found.type}, and a field path that it has')
            continue
        try:
            converter.check_type(topic, log.blank(name))
        except FieldError as error:
            findings.error(error.key, str(error).partition(': ')[2])
            continue
        except LogError as error:
            findings.error(name, str(error))
            continue
        findings.ok(' and '.join(inputs), f'{name} {found.type}')
        readable[name] = topic
    return readable


def _hint(log: Log, name: str, type_name: str, there: Sequence[str]) -> str:
    """Return a topic that could be meant: best one of the same type."""
    same = [other for other in there if log.topics[other].type == normalised(type_name)]
    return nearest(name, same) or nearest(name, there) or (
        f'; {same[0]} has that type' if len(same) == 1 else '')
