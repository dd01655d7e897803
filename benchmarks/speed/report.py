"""
Size of the HTML report, and how fast it opens: ``python -m benchmarks.speed.report``.

One simulated trial of ten minutes (10 Hz, three DOFs) is compared by all methods, and headless
Chromium opens the report, on a desktop and with the size of a phone.
"""

from __future__ import annotations

import argparse
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from rovid_ros.commands.main import main as rovid

from benchmarks.markdown import table
from test.support.headless_browser import browser

ROOT = Path(__file__).parents[2]
CONFIG = str(ROOT / 'config' / 'jhurov.yaml')

LOADED = 'performance.getEntriesByType("navigation")[0].loadEventEnd'
DRAWN = """new Promise(done => {
  const look = () => document.querySelector("#figure0[data-drawn]")
    ? done(performance.now()) : setTimeout(look, 20);
  document.querySelector("#figure0").scrollIntoView();
  look();
})"""


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--duration', default='600', help='of the trial [s]')
    args = parser.parse_args()
    with TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        log, page = str(folder / 'trial.mcap'), folder / 'report.html'
        with redirect_stdout(StringIO()):
            rovid(['simulate', '--params-file', CONFIG, '--duration', args.duration,
                   '--output', log])
            rovid(['compare', log, '--params-file', CONFIG, '--report', str(page)])
        rows = []
        for title, width, height, phone in (
                ('desktop', 1280, 900, False), ('phone', 390, 844, True)):
            times = []
            for _ in range(args.runs):
                with browser(folder) as shown:
                    shown.resize(width, height, phone=phone)
                    shown.open(page)
                    times.append((shown.evaluate(LOADED), shown.evaluate(DRAWN)))
            loaded, drawn = (median(column) / 1e3 for column in zip(*times))
            rows.append((title, f'{page.stat().st_size / 1e6:.1f}', f'{loaded:.2f}',
                         f'{drawn:.2f}'))
    print(table(('shown on', 'size [MB]', 'open after [s]', 'first plots drawn after [s]'), rows))


if __name__ == '__main__':
    main()
