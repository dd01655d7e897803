"""The command that makes the tables of docs/measurements/ again."""

from dataclasses import replace
import importlib.util
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

from benchmarks import figures
from test.support.processes import child_environment, patience


def test_every_section_is_made_by_a_module() -> None:
    for _, sections in figures.PARTS.values():
        for section in sections.values():
            assert importlib.util.find_spec(f'benchmarks.{section.module}'), section.module


def test_a_part_or_one_section_of_it() -> None:
    assert list(figures.chosen(figures.PARTS)) == list(figures.PARTS)
    assert figures.chosen(['speed.step', 'faults.kills']) == {
        'speed': ['step'], 'faults': ['kills']}
    with pytest.raises(ValueError, match="no part 'sped'"):
        figures.chosen(['sped'])
    with pytest.raises(ValueError, match="no section 'stop': speed takes"):
        figures.chosen(['speed.stop'])


def test_a_section_is_put_in_its_place_and_the_others_stay(tmp_path: Path) -> None:
    page = tmp_path / 'endurance.md'
    figures.write(page, 'endurance', {'The node on DDS': '| a |\n\nmade so'})
    figures.write(page, 'endurance', {
        **figures.sections_of(page), 'Simulated time': 'another', 'of before': 'goes'})
    assert figures.sections_of(page) == {
        'Simulated time': 'another', 'The node on DDS': '| a |\n\nmade so'}
    text = page.read_text()
    assert text.index('## Simulated time') < text.index('## The node on DDS')


def test_what_is_printed_is_kept_with_how_it_was_made_and_a_failure_loses_nothing(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
) -> None:
    start = figures.PARTS['speed'][1]['start']
    monkeypatch.setitem(figures.PARTS, 'speed', ('What it costs', {
        'broken': replace(start, title='Broken', quick='--walks 2', alone=False),
        'start': start}))
    figures.write(tmp_path / 'speed.md', 'speed', {'Broken': 'as it was', 'Start': 'old'})
    monkeypatch.setattr(sys, 'argv', [
        'figures', 'speed', '--quick', '--output', str(tmp_path)])
    with pytest.raises(SystemExit, match='failed.*: speed.broken$'):
        figures.main()
    assert 'unrecognized arguments: --walks 2' in capfd.readouterr().err
    made = figures.sections_of(tmp_path / 'speed.md')
    assert made['Broken'] == 'as it was'
    assert '| import numpy |' in made['Start']
    assert '`python -m benchmarks.speed.start --runs 2`, commit ' in made['Start']
    assert figures.machine() in made['Start']


def test_an_interrupt_leaves_no_process(tmp_path: Path, repository: Path) -> None:
    with subprocess.Popen(
            [sys.executable, '-m', 'benchmarks.figures', 'accuracy.real', '--output', tmp_path],
            cwd=repository, env=child_environment(), stderr=subprocess.PIPE, text=True) as made:
        try:
            with patience(60.0):
                while not (module := children(made.pid)) or len(children(module[0])) < 2:
                    time.sleep(0.1)
        finally:
            made.send_signal(signal.SIGINT)
        _, err = made.communicate()
    assert err.splitlines()[-1] == 'interrupted: what was made before stays'
    assert made.returncode == 1
    assert not list(tmp_path.iterdir())
    with patience(), pytest.raises(ProcessLookupError):
        while True:  # who takes over its children may take a moment to bury them
            os.killpg(module[0], 0)
            time.sleep(0.1)


def children(process: int) -> list[int]:
    """Return the processes that one has started."""
    try:
        return [int(found) for listed in Path(f'/proc/{process}/task').glob('*/children')
                for found in listed.read_text().split()]
    except OSError:  # one of its threads has just ended
        return []
