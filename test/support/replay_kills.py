"""Replays that are killed at random moments, and what the next run makes of what is left."""

from __future__ import annotations

from pathlib import Path
import random
import signal
import subprocess
import sys
import time

from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.state_file import load as load_state

from test.support.kill_tally import configured, environment, Tally

MOST_FILES = 8
"""A log, parameters, output and its part, JSON, state, and what one kill can leave of two."""


class Replays:
    """
    Replays of one log that are killed and run again, each from the same saved state.

    Parameters
    ----------
    folder : Path
        An empty one.
    duration : float
        Of the log [s].

    """

    def __init__(self, folder: Path, duration: float = 60.0) -> None:
        self.folder = folder
        self.tally = Tally()
        self._config = configured(folder / 'vehicle.yaml')
        self._settings = settings_from(load(self._config))
        self._log = folder / 'log.mcap'
        simulate_log(self._settings, self._log, duration, seed=1)
        self._output, self._json, self._state = (
            folder / name for name in ('out.mcap', 'out.json', 'state.json'))
        self._part = folder / 'out.part.mcap'
        assert self._start().wait() == 0
        self._before = self._state.read_bytes()
        began = time.monotonic()
        assert self._start().wait() == 0
        self.duration = time.monotonic() - began
        self._after = self._state.read_bytes()
        self._good = self._output.read_bytes(), self._json.read_bytes()
        self._count = len(self.tally.opened(self._output, 1))
        self._state.write_bytes(self._before)
        self.tally = Tally()

    def kill(self, delay: float, written: bool = False) -> None:
        """
        Start, kill it after so many seconds, and look at what is there.

        Where something has to be ``written``, not before that, however busy the machine is.
        """
        process = self._start()
        try:
            process.wait(delay)
        except subprocess.TimeoutExpired:
            while written and process.poll() is None and not self._has_written():
                time.sleep(0.002)
            process.kill()
        code = process.wait()
        if code == 0:
            self._check_end()
            return
        self.tally.kills += 1
        self.tally.check(code == -signal.SIGKILL, f'it had ended with {code}')
        self._look()

    def finish(self) -> None:
        """Let the last one come to its end."""
        self.tally.check(self._start().wait() == 0, 'the run after it failed')
        self._check_end()

    def _start(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, '-m', 'rovid_ros.commands', 'replay', self._log, '--params-file',
             self._config, '--output', self._output, '--json', self._json, '--state',
             self._state], env=environment(), stdout=subprocess.DEVNULL)

    def _has_written(self) -> bool:
        return self._part.exists() and self._part.stat().st_size > 0

    def _look(self) -> None:
        tally = self.tally
        try:
            load_state(self._state, self._settings)
            tally.states += 1
        except ValueError as error:
            tally.check(False, str(error))
        tally.check(self._state.read_bytes() in (self._before, self._after),
                    f'{self._state.name} is neither the old nor the new one')
        self._state.write_bytes(self._before)
        if self._part.exists():
            tally.opened(self._part, 0)
        self._check_good()
        names = sorted(path.name for path in self.folder.iterdir())
        tally.leftovers = max(tally.leftovers, sum(name.startswith('.') for name in names))
        tally.check(len(names) <= MOST_FILES, f'the folder holds {", ".join(names)}')

    def _check_good(self) -> None:
        """See that what was whole under its name still is: the old one or all of the new one."""
        output, document = self._good
        if self._output.read_bytes() != output:
            times = Tally()
            self.tally.check(len(times.opened(self._output, self._count)) == self._count
                             and not times.faults, f'{self._output.name} is not whole')
        self.tally.check(self._json.read_bytes() == document, f'{self._json.name} is another')

    def _check_end(self) -> None:
        self.tally.finished += 1
        self._check_good()
        self.tally.check(self._state.read_bytes() == self._after,
                         f'{self._state.name} is not that of a run without kills')
        self._state.write_bytes(self._before)


def replay_kills(folder: Path, count: int, seed: int, duration: float = 60.0) -> Tally:
    """
    Kill replays at random moments.

    Parameters
    ----------
    folder : Path
        An empty one to work in.
    count : int
        How many kills; more if none of them has left a log with messages.
    seed : int
        Of the moments.
    duration : float
        Of the log [s].

    """
    chance, replays = random.Random(seed), Replays(folder, duration)
    tally = replays.tally
    while tally.kills < count or not tally.messages and tally.kills < 10 * count:
        replays.kill(chance.uniform(0.3, 0.9) * replays.duration, tally.kills >= count)
    replays.finish()
    return tally
