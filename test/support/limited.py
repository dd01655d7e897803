"""A command with little memory: in a process that is forked where all is imported already."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing import get_context
import os
from pathlib import Path
import resource
import subprocess
import sys

FORKS = get_context('forkserver')
FORKS.set_forkserver_preload(['rovid_ros.commands.main', 'rovid_ros.commands.replay'])
PATIENCE = 120.0  # [s]


def run_limited(arguments: Sequence[object], memory: int, stderr: Path
                ) -> subprocess.CompletedProcess[str]:
    """Run ``rovid`` with so many bytes of addresses; ``stderr`` takes what it says there."""
    words = [*map(str, arguments)]
    process = FORKS.Process(target=_run, args=(words, memory, str(stderr)))
    process.start()
    process.join(PATIENCE)
    assert process.exitcode is not None, f'it still runs: {words}'
    return subprocess.CompletedProcess(words, process.exitcode, '', stderr.read_text())


def _run(words: list[str], memory: int, stderr: str) -> None:
    from rovid_ros.commands.main import main
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    for number, path in ((1, os.devnull), (2, stderr)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    sys.exit(main(words))
