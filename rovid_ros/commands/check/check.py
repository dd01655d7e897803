"""``rovid check``: a configuration by itself, against a log, or against the live graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rovid_core.settings.run import Settings
from rovid_ros.commands.check.data import Observation
from rovid_ros.commands.check.findings import check_text, ERROR, Findings
from rovid_ros.commands.check.log import check_log
from rovid_ros.commands.check.settings import check_settings, read_settings
from rovid_ros.commands.ending import CommandError


@dataclass(frozen=True)
class Asked:
    """What to check against; the command line has the meaning of each."""

    logs: Sequence[Path] = ()
    start: float = 0.0
    duration: float | None = None
    live: bool = False
    timeout: float = 5.0
    namespace: str = ''


@dataclass(frozen=True)
class Outcome:
    """What to print, the number of errors, all in one line, and what ``--json`` writes."""

    text: str
    errors: int
    verdict: str
    document: dict[str, Any]


def check(path: Path, asked: Asked) -> Outcome:
    """
    Check a parameter file.

    Raises
    ------
    CommandError
        If the live graph is asked for where there is no ROS.

    """
    findings = Findings()
    settings = read_settings(path, findings)
    seen: Observation | None = None
    if settings is not None:
        alone = not asked.live and not asked.logs
        check_settings(settings, findings,
                       installed=find_spec('rclpy') is not None if alone else None)
        if asked.live:
            seen = _live(settings, findings, asked)
        elif asked.logs:
            seen = check_log(asked.logs, settings, findings, asked.start, asked.duration)
    return Outcome(
        check_text(path, settings, findings), findings.count(ERROR), findings.verdict(), {
            'file': str(path), 'logs': [str(log) for log in asked.logs], 'live': asked.live,
            'errors': findings.count(ERROR), 'findings': findings.document(),
            **(seen.document() if seen else {})})


def _live(settings: Settings, findings: Findings, asked: Asked) -> Observation:
    try:
        from rovid_ros.node.live_check import LiveCheck
    except ImportError as error:
        raise CommandError(
            f'--live needs ROS 2, which is not installed here: {error}') from None
    try:
        live = LiveCheck(settings, findings, asked.namespace)
    except (RuntimeError, ValueError) as error:  # of rcl: an impossible domain or namespace
        raise CommandError(f'--live: {str(error).splitlines()[0]}') from None
    try:
        return live.run(asked.timeout)
    finally:
        live.close()
