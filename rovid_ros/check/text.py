"""What ``rovid check`` prints: how it reads the file, in tables, and what it found."""

from __future__ import annotations

from pathlib import Path

from rovid_core.dofs import DOFS, PHYSICAL
from rovid_core.identifier import Scales
from rovid_core.settings import Settings
from rovid_ros.check.findings import Findings
from rovid_ros.input_topics import needs, section, topics_of
from rovid_ros.report import number, table
from rovid_ros.units import unit


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
