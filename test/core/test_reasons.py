"""Every reason that something is refused for has its meaning in one table."""

import ast
from pathlib import Path
import re

from rovid_core.inputs.refusals import REASONS

REPOSITORY = Path(__file__).parents[2]
TELLING = {'reject', '_reject', '_drop', '_interrupt', '_refuse', '_count', 'RefusedError'}
"""Calls that are given a reason."""

RETURNING = {
    'outlier_gate': ('check',), 'stuck_sensor': ('check',),
    'force_history': ('add_commands', 'missing'), 'steps': ('_add', '_add_measurement'),
    'velocity_source': ('next_velocity',), 'attitude_history': ('missing',),
    'adaptive_identifier': ('step',), 'extended_kalman': ('step',)}
"""Functions that return one, or ''."""

NO_REASONS = {'first', 'later'}
"""The beginning, and what is waited for: neither is counted."""


def words(node):
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)
            and isinstance(n.value, str) and re.fullmatch('[a-z]+(_[a-z]+)*', n.value)}


def produced():
    """Return the reasons in the sources, each with where it is."""
    found, returning = {}, dict(RETURNING)
    for package in ('rovid_core', 'rovid_ros'):
        for path in sorted((REPOSITORY / package).rglob('*.py')):
            if path.parent.name == 'report':
                continue  # counts other things
            functions = returning.pop(path.stem, ())
            for node in ast.walk(ast.parse(path.read_text())):
                nodes = []
                if isinstance(node, ast.Call):
                    name = getattr(node.func, 'attr', getattr(node.func, 'id', ''))
                    nodes = node.args[-2:] if name in TELLING else []
                elif isinstance(node, ast.FunctionDef) and node.name in functions:
                    nodes = [n for n in ast.walk(node) if isinstance(n, ast.Return) and n.value]
                for one in nodes:
                    found.update(dict.fromkeys(words(one), f'{path.name}:{one.lineno}'))
    assert not returning  # all were there
    return found


def test_every_reason_has_a_meaning():
    found = produced()
    inputs = {'position', 'depth', 'attitude', 'velocity', 'angular_velocity', 'name'}
    unknown = {reason: where for reason, where in found.items()
               if reason not in REASONS.keys() | NO_REASONS | inputs}
    assert unknown == {}


def test_every_meaning_has_a_reason():
    source = ''.join(path.read_text() for package in ('rovid_core', 'rovid_ros')
                     for path in (REPOSITORY / package).rglob('*.py')
                     if path.name != 'refusals.py')
    assert [reason for reason in REASONS if f"'{reason}'" not in source] == []


def test_the_meanings_are_lines_for_people():
    for reason, meaning in REASONS.items():
        assert len(meaning) < 80, reason
        assert meaning[0].islower() and not meaning.endswith('.'), reason
