"""
Break the code on purpose, one line at a time, and see whether the tests notice.

``python -m benchmarks.faults.mutants [WORD ...] [--workers N]`` runs those whose file or
description has a word, or all. Each is put into a copy of what is in the work tree, never into the
work tree itself, and its narrow tests are run there: they must pass without it and fail with it.
One whose old text is not there any more, or more than once, is told; it has to be written anew.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
import os
from pathlib import Path
from queue import SimpleQueue
import shutil
import subprocess
import sys
from tempfile import TemporaryDirectory

from benchmarks.faults.mutant_list import Mutant, MUTANTS

REPOSITORY = Path(__file__).resolve().parents[2]
PASSED, FAILED = 0, (1, 2, 3)  # exit codes of pytest; others say that there are no such tests
PATIENCE = 1800.0  # [s], on a machine that is busy; tests that hang have noticed


def main(argv: Sequence[str] | None = None) -> int:
    """Run them; returns 1 unless all are killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('words', nargs='*')
    parser.add_argument('--workers', type=int, default=2)
    args = parser.parse_args(argv)
    chosen = [mutant for mutant in MUTANTS if not args.words or any(
        word in f'{mutant.file} {mutant.what}' for word in args.words)]
    wrong = 0
    with TemporaryDirectory(prefix='rovid-mutants-') as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(args.workers):
            copies.put(copy_to(Path(folder) / str(number)))
        tests = sorted({test for mutant in chosen for test in mutant.tests})
        copy = copies.get()
        sound = tests if run(copy, tests) == PASSED else [
            test for test in tests if run(copy, (test,)) == PASSED]
        copies.put(copy)
        for test in tests:
            if test not in sound:
                print(f'fails already: {test}', flush=True)

        def judge(mutant: Mutant) -> str:
            if not set(mutant.tests) <= set(sound):
                return 'has no tests that pass without it'
            copy = copies.get()
            try:
                return outcome(mutant, copy)
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(args.workers) as pool:
            for mutant, said in zip(chosen, pool.map(judge, chosen)):
                wrong += said != 'killed'
                print(f'{said:10}  {mutant.file}: {mutant.what}', flush=True)
    print(f'{len(chosen) - wrong} of {len(chosen)} killed')
    return 1 if wrong else 0


def copy_to(folder: Path) -> Path:
    """Copy the files of the repository as they are in the work tree."""
    names = subprocess.run(['git', 'ls-files', '-co', '--exclude-standard'], cwd=REPOSITORY,
                           check=True, capture_output=True, text=True).stdout.splitlines()
    for name in names:
        if (REPOSITORY / name).is_file():  # not one that was deleted and is not committed yet
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(REPOSITORY / name, folder / name)
    return folder


def outcome(mutant: Mutant, copy: Path) -> str:
    """Return ``killed``, or what else came of it."""
    path = copy / mutant.file
    sound = path.read_text() if path.exists() else ''
    if sound.count(mutant.old) != 1:
        return f'is there {sound.count(mutant.old)} times'
    try:
        path.write_text(sound.replace(mutant.old, mutant.new))
        code = run(copy, mutant.tests)
    finally:
        path.write_text(sound)
    return 'SURVIVED' if code == PASSED else 'killed' if code in FAILED else (
        f'pytest ended with {code}')


def run(copy: Path, tests: Sequence[str]) -> int:
    """Run tests in a copy; returns the exit code of pytest."""
    # without caches: of two files of the same second and size the older one would be run
    environment = {**os.environ, 'PYTHONDONTWRITEBYTECODE': '1', 'PYTHONPATH': str(copy),
                   'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'}  # those of ROS take longer than a test
    try:
        return subprocess.run(
            [sys.executable, '-m', 'pytest', '-xq', '-m', '', '-p', 'no:cacheprovider', *tests],
            cwd=copy, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            timeout=PATIENCE).returncode
    except subprocess.TimeoutExpired:
        return FAILED[0]


if __name__ == '__main__':
    sys.exit(main())
