"""``ROVID_COMPILE=1`` compiles, or ends in a line that says why it does not."""

from importlib import import_module
from pathlib import Path
import subprocess
import sys

import pytest
import rovid_core


@pytest.mark.parametrize(('command', 'change', 'says'), [
    ('develop', {}, 'install without --editable'),
    ('editable_wheel', {}, 'install without --editable'),
    ('bdist_wheel', {'CC': 'no-such-compiler -pthread'}, "no C compiler 'no-such-compiler'"),
])
def test_a_line_says_why_it_does_not_compile(
        command: str, change: dict[str, str], says: str, repository: Path,
        environment: dict[str, str]) -> None:
    run = subprocess.run(
        [sys.executable, 'setup.py', '--quiet', command], cwd=repository, text=True,
        env={**environment, 'ROVID_COMPILE': '1', **change}, capture_output=True, timeout=60)
    assert run.returncode == 1
    assert run.stderr.startswith('ROVID_COMPILE=1: ')
    assert says in run.stderr
    assert run.stderr.count('\n') == 1


@pytest.mark.parametrize('name', ['model.samples', 'ordering.event_order', 'pipeline.steps'])
def test_what_is_on_the_way_of_a_message_is_compiled_or_all_of_it_is_not(name: str) -> None:
    file = import_module(f'rovid_core.{name}').__file__
    assert file is not None
    assert file.endswith('.py') != rovid_core.COMPILED
