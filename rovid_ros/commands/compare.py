"""``rovid compare``: every method on each log, each model scored on every log."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from rovid_ros.commands.arguments import add_json, add_params_file, add_part
from rovid_ros.commands.running import (
    check_written,
    located_errors,
    print_written,
    read_settings,
    warn,
)
from rovid_ros.comparison.compare import compare, document
from rovid_ros.comparison.report_data import report_data
from rovid_ros.comparison.text import comparison_text
from rovid_ros.comparison.trials import read_trials
from rovid_ros.files.whole_files import write_json

DESCRIPTION = (
    'Each log is a trial by itself: every method is trained on it, and each model predicts every '
    'log from its thrust alone.')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid compare`` takes."""
    add_params_file(command)
    command.add_argument(
        'logs', nargs='+', type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file, or rosbag2 directory')
    command.add_argument(
        '--validate', nargs='+', type=Path, metavar='LOG',
        help='logs to predict only, not to train on')
    command.add_argument(
        '--report', type=Path, metavar='OUT.html', help='write a report to look at and to send')
    add_json(command, 'models')
    add_part(command)


def run(args: argparse.Namespace) -> None:
    """Run ``rovid compare``."""
    validate = args.validate or []
    check_written([args.report, args.json], [*args.logs, *validate, args.params_file])
    settings = read_settings(args.params_file)
    with located_errors(args.params_file):
        trials = read_trials(
            args.logs, validate, settings, partial(warn, args.prog), start=args.start,
            duration=args.duration)
    models = compare(trials, settings)
    print(comparison_text(models, trials, settings))
    if args.json:
        write_json(args.json, document(models))
    if args.report:
        from rovid_ros.report.report import write_report  # its library is needed only here
        write_report(args.report, report_data(models, trials, settings))
    print_written(args.report, args.json)
