"""What a check found, a line each."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rovid_core.model.dofs import DOFS, PHYSICAL
from rovid_core.settings.run import Settings
from rovid_core.settings.scales import Scales
from rovid_ros.config.input_topics import needs, section, topics_of
from rovid_ros.results.text import number, table, unit

OK, WARNING, ERROR = 'OK', 'WARNING', 'ERROR'


@dataclass(frozen=True)
class Finding:
    """
    One thing that was looked at.

    Attributes
    ----------
    level : str
        OK, WARNING or ERROR.
    subject : str
        The key, topic or file that it is about.
    text : str
        What was found.
    advice : str
        What to change; '' if nothing.

    """

    level: str
    subject: str
    text: str
    advice: str = ''

    def __str__(self) -> str:
        """Return the line."""
        advice = f'; {self.advice}' if self.advice else ''
        return ' '.join(f'{self.level:<8}{self.subject}: {self.text}{advice}'.split('\n'))


class Findings:
    """All that was found, in the order in which it was looked at."""

    def __init__(self) -> None:
        self.all: list[Finding] = []

    def ok(self, subject: str, text: str) -> None:
        """Say that something is as it should be."""
        self.all.append(Finding(OK, subject, text))

    def warning(self, subject: str, text: str, advice: str = '') -> None:
        """Say that something looks wrong."""
        self.all.append(Finding(WARNING, subject, text, advice))

    def error(self, subject: str, text: str, advice: str = '') -> None:
        """Say that something cannot work."""
        self.all.append(Finding(ERROR, subject, text, advice))

    def count(self, level: str) -> int:
        """Return how many there are of a level."""
        return sum(one.level == level for one in self.all)

    def verdict(self) -> str:
        """Return how many errors and warnings there are."""
        counts = [(self.count(level), name)
                  for level, name in ((ERROR, 'error'), (WARNING, 'warning'))]
        parts = [f'{count} {name}{"s" if count > 1 else ""}' for count, name in counts if count]
        return ' and '.join(parts) or 'all is well'

    def document(self) -> list[dict[str, Any]]:
        """Return them for a program to read."""
        return [asdict(one) for one in self.all]


def check_text(path: Path, settings: Settings | None, findings: Findings) -> str:
    """Return the tables of the settings, if there are any, and a line for each finding."""
    parts = [] if settings is None else [
        f'{path}: {settings.identifier.method}, frames {settings.frames}', _inputs(settings),
        _dofs(settings), _thrusters(settings)]
    return '\n\n'.join([*parts, '\n'.join(map(str, findings.all))])


def _inputs(settings: Settings) -> str:
    rows = [['input', 'topic', 'type', 'field', 'drives']]
    for name in settings.used_inputs():
        given = settings.thrusters if name == 'thrusters' else settings.input(name)
        topics = topics_of(settings, name)
        dofs = [dof for dof in settings.dofs if name in needs(settings, dof)]
        drives = 'the score' if name == 'reference' else ', '.join(dofs) or '-'
        rows.append([section(name), topics[0] + (f' and {len(topics) - 1} more' if topics[1:]
                                                 else ''),
                     given.type or "(the log's)", given.field or '(all)', drives])
    return table(rows, left=5)


def _dofs(settings: Settings) -> str:
    rows = [['', 'velocity from', *(name.replace('_', ' ') for name in PHYSICAL),
             'typical force', 'typical velocity']]
    for dof in settings.dofs:
        known, scales = settings.dof[dof], Scales.of(settings.dof[dof])
        rows.append([
            dof, settings.source(dof),
            *(f'{number(getattr(known, name))} {unit(dof, name)}' for name in PHYSICAL),
            f'{number(scales.force)} {unit(dof, "bias")}',
            f'{number(scales.velocity)} {unit(dof, "mae")}'])
    return table(rows, left=2)


def _thrusters(settings: Settings) -> str:
    thrusters = settings.thrusters
    rows = [['thruster', 'gain', *DOFS]]
    for i, gain in enumerate(thrusters.gain):
        name = thrusters.names[i] if thrusters.names else str(i + 1)
        rows.append([name, number(gain), *(f'{row[i]:g}' for row in thrusters.allocation)])
    return table(rows)
