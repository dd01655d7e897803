"""
Make docs/report.png again; ``make picture`` runs this.

``python -m benchmarks.report_picture [--output FILE.png]``

Two trials are simulated and compared, and Chromium shows the parts of the report that say most:
what was identified, the cross-validation of surge, and surge over time.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

from rovid_ros.commands.main import main as rovid

from test.support.headless_browser import browser

ROOT = Path(__file__).resolve().parents[1]
CONFIG = str(ROOT / 'config' / 'jhurov.yaml')
WIDTH, HEIGHT = 1000, 1700  # [px]

SELECT = """
for (const section of document.querySelectorAll('main > section')) {
  if (!['found', 'prediction', 'plots-surge'].includes(section.id)) section.remove();
}
for (const other of document.querySelectorAll(
  'nav, .hint, #prediction .scroll:not(:first-of-type), #plots-surge h3')) other.remove();
for (const row of document.querySelectorAll('#prediction tbody tr:nth-child(n+8)')) row.remove();
scrollTo(0, 0);
"""


def main() -> None:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'report.png')
    output: Path = parser.parse_args().output
    with TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        logs = [str(folder / 'trial1.mcap'), str(folder / 'trial2.mcap')]
        for seed, log in enumerate(logs, 1):
            check(['simulate', '--params-file', CONFIG, '--duration', '300', '--seed', str(seed),
                   '--output', log])
        page = folder / 'report.html'
        check(['compare', *logs, '--params-file', CONFIG, '--report', str(page)])
        with browser(folder) as shown:
            shown.resize(WIDTH, HEIGHT)
            shown.call('Emulation.setScrollbarsHidden', hidden=True)
            shown.open(page)
            shown.evaluate(SELECT)
            shown.evaluate('new Promise(done => { const look = () => document.querySelector('
                           '"#figure0[data-drawn]") ? done(0) : setTimeout(look, 50); look(); })')
            shown.settle()
            shown.screenshot(output)


def check(arguments: list[str]) -> None:
    """Run a command of rovid, and end with its exit code where it fails."""
    if code := rovid(arguments):
        sys.exit(code)


if __name__ == '__main__':
    main()
