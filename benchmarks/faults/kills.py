"""
``kill -9`` at random moments: what is left on the disk, and what the next run makes of it.

``python -m benchmarks.faults.kills [--count N] [--seed N]`` prints the table.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

from benchmarks.markdown import row
from test.support.replay_kills import replay_kills

INTRODUCTION = """\
Replays are killed 0.3 to 0.9 times the length of a whole run after their start, and run again from
the same saved state; nodes up to 5 s after they opened their files, and each goes on from the
state of the one before. A fault would be a saved state that does not load, or is neither the one
before a replay nor the one after it; a log in which our reader or that of `mcap` finds less than
was flushed; a result file that is neither the good one from before nor whole; a result that is
not, bit for bit, that of a run without kills; a folder that fills up. Time lost is from the last
message in the node's record to the kill: it is flushed every second.
"""
COLUMNS = ('killed', 'kills', 'states that loaded', 'logs that opened', 'messages in them',
           'runs that came to their end', 'time lost at most [s]', 'temporary files at most',
           'faults')


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--count', type=int, default=50, help='kills of each kind (50)')
    parser.add_argument('--seed', type=int, default=1, help='of the moments (1)')
    args = parser.parse_args()
    import rclpy  # noqa: F401 first, for the ROS wheels from PyPI start python again

    from test.support.live_kills import live_kills
    print(f'{INTRODUCTION}\n{row(*COLUMNS)}\n{row(*["---"] * len(COLUMNS))}')
    faults: list[str] = []
    for name, series in (('replaying', replay_kills), ('live over DDS', live_kills)):
        with TemporaryDirectory(prefix='kills-') as folder:
            tally = series(Path(folder), args.count, args.seed)
        print(row(name, tally.kills, tally.states, tally.logs, f'{tally.messages:,}',
                  tally.finished, f'{tally.lost:.1f}' if tally.lost else '-', tally.leftovers,
                  len(tally.faults)), flush=True)
        faults += [f'{name}: {line}' for line in tally.faults]
    sys.exit('\n'.join(faults) or 0)


if __name__ == '__main__':
    main()
