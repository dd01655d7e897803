"""
Make every table of docs/measurements/ again; ``make figures`` runs this.

``python -m benchmarks.figures [PART | PART.SECTION ...] [--quick] [--output FOLDER]``

Each part is a file, and each section of it what one module prints, with the command, the commit,
the date and the machine below it. Two sections are made at a time, except where time is measured:
nothing runs beside those. Of a section that fails, what was made before stays. ``--quick`` tries
everything with small sizes. The tank recordings are looked for in ``ROVID_DATA`` and in
``../shared/data``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import as_completed, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime, timezone
import os
from pathlib import Path
import platform
import re
import shlex
import signal
import subprocess
import sys
import time

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'docs' / 'measurements'
PATIENCE = 10.0  # [s] that a module has to clean up after an interrupt

_RUNNING: set[subprocess.Popen[str]] = set()


@dataclass(frozen=True)
class Section:
    """
    What one module prints.

    Attributes
    ----------
    title : str
        Above it.
    module : str
        Below ``benchmarks``.
    arguments, quick : str
        Of a run whose result is kept, and of one that only tries whether it works.
    minutes : float
        That the former takes by itself on two idle cores.
    recordings : bool
        Whether the module takes the folder of the tank recordings.
    alone : bool
        Whether nothing may run beside it, because it measures time or drives a live node.

    """

    title: str
    module: str
    arguments: str
    quick: str
    minutes: float
    recordings: bool = False
    alone: bool = False


PARTS: dict[str, tuple[str, dict[str, Section]]] = {
    'accuracy': ('How right the models are', {
        'adaptive': Section('The adaptive identifier', 'accuracy.adaptive_identifier',
                            '--seeds 12', '--seeds 1', 1.0, recordings=True),
        'online': Section('The online methods', 'accuracy.online_methods', '--seeds 40',
                          '--seeds 2', 2.0, recordings=True),
        'real': Section('Vehicles that are not the model', 'accuracy.real_vehicles', '--seeds 40',
                        '--seeds 1 --duration 60', 2.0),
        'real_configured': Section(
            'The same with what they have configured', 'accuracy.real_vehicles',
            '--configured --seeds 40', '--configured --seeds 1 --duration 60', 1.0),
        'real_configured_aid': Section(
            'With what they have configured, by aid', 'accuracy.real_vehicles',
            '--configured --method aid --seeds 20',
            '--configured --method aid --seeds 1 --duration 60', 0.8),
        'real_aid': Section('Vehicles that are not the model, by aid', 'accuracy.real_vehicles',
                            '--method aid --seeds 40', '--method aid --seeds 1 --duration 60',
                            0.8),
        'recordings': Section('Real recordings, each alone', 'accuracy.recordings', '',
                              '--only pool', 2.0, recordings=True),
        'first_hour': Section('From a log that nobody has configured', 'accuracy.first_hour', '',
                              '--seeds 1 --only lbl', 4.0, recordings=True),
        'between': Section('Whether recordings of one vehicle agree', 'accuracy.between', '', '',
                           0.2, recordings=True),
        'unchanged': Section('Vehicles that do not change', 'accuracy.unchanged', '--hours 3',
                             '--hours 1 --only exact', 3.2),
        'coupled': Section('Vehicles that move in all axes at once', 'accuracy.coupled_vehicles',
                           '', '--seeds 1 --duration 60', 2.0),
        'six_axes': Section('A BlueROV2 in six axes', 'accuracy.six_axes', '--seeds 4',
                            '--seeds 1 --duration 120 --only all', 36.0),
        'control': Section('A controller with feed-forward', 'accuracy.feed_forward',
                           '--seeds 10', '--seeds 1 --duration 90', 4.5),
        'coupled_aid': Section('All axes at once, by aid', 'accuracy.coupled_vehicles',
                               '--method aid', '--method aid --seeds 1 --duration 60', 1.0),
        'current': Section('In water that moves, and with slow fixes', 'accuracy.current',
                           '--seeds 40', '--seeds 1 --short --only tide', 65.0, recordings=True),
        'offline': Section('The offline methods', 'accuracy.offline_methods', '--seeds 12',
                           '--seeds 2', 1.8, recordings=True),
    }),
    'speed': ('What it costs', {
        'replay': Section('Replay', 'speed.replay', '--runs 1', '--runs 1', 6.5, alone=True),
        'compiled': Section('Compiled', 'speed.compiled', '--runs 1', '', 10.0, alone=True),
        'odometry': Section('A vehicle with everything', 'speed.odometry', '--runs 3',
                            '--runs 1 --seconds 5', 2.0, alone=True),
        'dataflash': Section("A log of ArduSub's", 'speed.dataflash', '--runs 3',
                             '--runs 1 --seconds 20', 1.8, alone=True),
        'long': Section('A long replay', 'speed.replay', '--long 3 --runs 1', '', 3.0,
                        alone=True),
        'step': Section('One step', 'speed.step', '', '--runs 1', 0.2, alone=True),
        'route': Section('The route of a message', 'speed.trace_message', '', '', 0.2),
        'start': Section('Start', 'speed.start', '', '--runs 2', 0.2, alone=True),
        'report': Section('The HTML report', 'speed.report', '', '--runs 1 --duration 60', 0.6,
                          alone=True),
        'survey': Section('A survey of many dives', 'speed.survey', '--dives 50',
                          '--dives 4 --duration 20', 3.5, alone=True),
        'tune': Section('Tuning', 'speed.tune', '--runs 3', '--runs 1', 1.5, alone=True),
        'live': Section('The live node', 'speed.latency', '--runs 3', '--runs 1 --seconds 1', 3.0,
                        alone=True),
        'load': Section('Load', 'speed.load', '--duration 5', '--duration 1 --rates 50', 2.5,
                        alone=True),
    }),
    'faults': ('What goes wrong, and what comes of it', {
        'campaign': Section('Faults in the messages', 'faults.campaign', '--live',
                            '--only nan --live', 11.0, recordings=True, alone=True),
        'mistakes': Section('Mistakes in a configuration', 'faults.mistakes', '--seeds 2',
                            '--seeds 1 --right 1 --duration 30', 3.0, recordings=True),
        'kills': Section('kill -9 at random moments', 'faults.kills', '--count 15', '--count 2',
                         2.0, alone=True),
    }),
    'endurance': ('Long runs', {
        'simulated': Section('Simulated time', 'endurance.soak', '--hours 0.3', '--hours 0.02',
                             2.7),
        'live': Section('The node on DDS', 'endurance.soak', '--live 120', '--live 10', 2.3,
                        alone=True),
    }),
}


def all_made(names: Iterable[tuple[str, str]], quick: bool) -> Iterator[tuple[str, str, str]]:
    """
    Make sections, two at a time and in the end one by one those that have to be alone.

    Yields
    ------
    part, section, text : str
        As soon as it is there; no text if it has failed.

    """
    sections = {name: PARTS[name[0]][1][name[1]] for name in names}
    for alone in (False, True):
        with ThreadPoolExecutor(1 if alone else 2) as pool:
            runs = {pool.submit(made, section, quick): name
                    for name, section in sections.items() if section.alone is alone}
            try:
                for run in as_completed(runs):
                    yield *runs[run], run.result()
            finally:  # of an interrupt: begin no more of them, and end those that run
                pool.shutdown(wait=False, cancel_futures=True)
                while not all(run.done() for run in runs):
                    for process in [*_RUNNING]:
                        _end(process)
                    time.sleep(0.1)


def made(section: Section, quick: bool) -> str:
    """Run a module; return what it printed and how that was made, and nothing if it failed."""
    arguments = shlex.split(section.quick if quick else section.arguments)
    if section.recordings and (logs := recordings()):
        arguments.insert(0, str(logs))
    began = time.monotonic()
    # on its own: a process that has imported much gives its peak memory to its children
    with subprocess.Popen(
            [sys.executable, '-m', f'benchmarks.{section.module}', *arguments], cwd=ROOT,
            env={**os.environ, 'PYTHONPATH': str(ROOT), 'OPENBLAS_NUM_THREADS': '1'},
            stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        _RUNNING.add(process)
        printed, _ = process.communicate()
        _RUNNING.remove(process)
    if process.returncode:
        print(f'{printed}\nexit code {process.returncode}', file=sys.stderr)
        return ''
    command = ' '.join(['python', '-m', f'benchmarks.{section.module}', *(
        'bluerov2_tank' if one == str(recordings()) else one for one in arguments)])
    notes = [f'`{command}`, commit {commit()}, {datetime.now(timezone.utc):%Y-%m-%d}, '
             f'{(time.monotonic() - began) / 60:.1f} min on {machine()}.']
    if section.recordings and not recordings():
        notes.append('The tank recordings were not there.')
    return f'{printed.strip()}\n\n{" ".join(notes)}'


def _end(process: subprocess.Popen[str]) -> None:
    """End a module and all that it has started, which is its process group."""
    for signal_number, patience in ((signal.SIGINT, PATIENCE), (signal.SIGKILL, None)):
        try:
            os.killpg(process.pid, signal_number)
            process.wait(patience)
        except subprocess.TimeoutExpired:
            pass
        except ProcessLookupError:  # all of it is gone
            return


def recordings() -> Path | None:
    """Return the folder of the tank recordings, where it is there."""
    data = Path(os.environ.get('ROVID_DATA', ROOT.parent / 'shared' / 'data'))
    return data / 'bluerov2_tank' if (data / 'bluerov2_tank').is_dir() else None


def commit() -> str:
    """Return the commit of the sources, and whether they differ from it."""
    try:
        name, changes = (subprocess.run(
            ['git', *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout
            for arguments in (('rev-parse', '--short', 'HEAD'),
                              ('status', '--porcelain', '--', ':!docs')))
    except (OSError, subprocess.CalledProcessError):
        return 'unknown'
    return name.strip() + (' with changes' if changes else '')


def machine() -> str:
    """Return processor and Python."""
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        text = ''
    names = re.findall(r'^model name\s*:\s*(.*)$', text, re.M)
    return (f'{names[0] if names else platform.processor() or platform.machine()}, '
            f'{os.cpu_count()} cores, Python {platform.python_version()}')


def sections_of(page: Path) -> dict[str, str]:
    """Return the text of each section of a page that was made before, by its title."""
    text = page.read_text(encoding='utf-8') if page.exists() else ''
    return dict(re.findall(r'^## ([^\n]*)\n\n(.*?)\s*(?=^## |\Z)', text, re.M | re.S))


def write(page: Path, name: str, texts: Mapping[str, str]) -> None:
    """Write a part: its sections that have been made, in their order."""
    title, sections = PARTS[name]
    minutes = sum(section.minutes for section in sections.values())
    parts = [f'# {title}', f"`make figures ARGS='{name}'` makes this file again, in about "
             f'{minutes:.0f} minutes.']
    for section in sections.values():
        if section.title in texts:
            parts += [f'## {section.title}', texts[section.title]]
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text('\n\n'.join(parts) + '\n', encoding='utf-8')


def chosen(names: Iterable[str]) -> dict[str, list[str]]:
    """
    Return part -> names of its sections that are asked for.

    Raises
    ------
    ValueError
        If there is no such part or section.

    """
    found: dict[str, list[str]] = {}
    for name in names:
        part, _, section = name.partition('.')
        if part not in PARTS:
            raise ValueError(f'no part {part!r}: takes {", ".join(PARTS)}')
        sections = PARTS[part][1]
        if section and section not in sections:
            raise ValueError(f'no section {section!r}: {part} takes {", ".join(sections)}')
        found.setdefault(part, []).extend([section] if section else sections)
    return found


def main() -> None:
    """Make what is asked for, and write each as soon as it is there."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('parts', nargs='*', metavar='PART[.SECTION]',
                        help=f'{", ".join(PARTS)}; default: all')
    parser.add_argument('--quick', action='store_true', help='try it with small sizes')
    parser.add_argument('--output', type=Path, default=FOLDER, metavar='FOLDER')
    given = parser.parse_args()
    try:
        asked = chosen(given.parts or PARTS)
    except ValueError as error:
        parser.error(str(error))
    names = [(part, name) for part, sections in asked.items() for name in sections
             if PARTS[part][1][name].quick or not given.quick]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    failed = []
    for part, name, text in all_made(names, given.quick):
        if text:
            page = given.output / f'{part}.md'
            write(page, part, {**sections_of(page), PARTS[part][1][name].title: text})
        else:
            failed.append(f'{part}.{name}')
        print(f'{part}.{name}: {text.splitlines()[-1] if text else "failed"}', file=sys.stderr,
              flush=True)
    if not given.parts and not given.quick:  # all are made: what no command makes goes
        for page in given.output.glob('*.md'):
            if page.stem not in PARTS:
                page.unlink()
    if failed:
        raise SystemExit(f'failed, so what was there before stays: {", ".join(failed)}')


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        raise SystemExit('interrupted: what was made before stays') from None
