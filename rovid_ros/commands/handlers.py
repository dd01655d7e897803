"""
What the subcommands of ``rovid`` do with their arguments.

What they need is imported when they run.
"""

from __future__ import annotations

import argparse
from functools import partial
import os
import sys
from typing import TYPE_CHECKING

from rovid_ros.commands.ending import (
    check_written,
    CommandError,
    naming,
    printable,
    read_settings,
    read_values,
    UsageError,
)

if TYPE_CHECKING:
    from rovid_core.settings.run import Settings
    from rovid_ros.commands.feeder import Feeder


def check(args: argparse.Namespace) -> None:
    """Run ``rovid check``."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    from rovid_ros.commands.check.check import Asked, check as run_check
    from rovid_ros.files.whole_files import write_json
    if args.live and args.logs:
        raise UsageError('--live and a LOG exclude each other')
    for name in ('timeout', 'namespace'):
        if getattr(args, name) and not args.live:
            raise UsageError(f'--{name} goes with --live')
    for name in ('start', 'duration'):
        if getattr(args, name) is not None and not args.logs:
            raise UsageError(f'--{name} goes with a LOG')
    check_written([args.json], [*args.logs, args.params_file])
    outcome = run_check(args.params_file, Asked(
        args.logs, args.start or 0.0, args.duration, args.live, args.timeout or 5.0,
        args.namespace))
    print(outcome.text)
    if args.json:
        write_json(args.json, outcome.document)
        print(f'written   {args.json}')
    if outcome.errors:
        raise CommandError(f'{args.params_file}: {outcome.verdict}')
    print(outcome.verdict)


def compare(args: argparse.Namespace) -> None:
    """Run ``rovid compare``."""
    # the cores go to the fits: numpy's threads cost small matrices more than they give
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    from rovid_ros.comparison.compare import compare as compare_methods, document
    from rovid_ros.comparison.report_data import report_data
    from rovid_ros.comparison.text import comparison_text
    from rovid_ros.comparison.trials import read_trials
    from rovid_ros.files.whole_files import write_json
    from rovid_ros.report.report import write_report
    validate = args.validate or []
    check_written([args.report, args.json], [*args.logs, *validate, args.params_file])
    settings = read_settings(args.params_file)

    with naming(args.params_file):
        trials = read_trials(
            args.logs, validate, settings, partial(_warn, args.prog), start=args.start,
            duration=args.duration)
    models = compare_methods(trials, settings)
    print(comparison_text(models, trials, settings))
    if args.json:
        write_json(args.json, document(models))
    if args.report:
        write_report(args.report, report_data(models, trials, settings))
    for path in filter(None, (args.report, args.json)):
        print(f'written   {path}')


def replay(args: argparse.Namespace) -> None:
    """Run ``rovid replay``."""
    from rovid_core.trials.score import ScoreLog
    from rovid_ros.commands.feeder import PipeFeeder
    from rovid_ros.commands.replay import replay as run_replay
    from rovid_ros.commands.replay_checkpoint import ReplayCheckpoint
    from rovid_ros.files.output_log import part_of
    from rovid_ros.files.whole_files import write_json
    from rovid_ros.results.text import report
    if args.rate is not None and not args.ros:
        raise UsageError('--rate goes with --ros')
    if args.checkpoint and args.ros:
        raise UsageError('--checkpoint does not go with --ros')
    if args.append and not args.checkpoint:
        raise UsageError('--append goes with --checkpoint')
    unfinished = part_of(args.output) if args.output else None
    check_written([*{args.output, unfinished}, args.json, args.checkpoint],
                  [*args.logs, args.params_file])
    settings = read_settings(args.params_file, args.method)
    checkpoint = ReplayCheckpoint(
        args.checkpoint, args.append, settings.checkpoint_period) if args.checkpoint else None

    with naming(args.params_file):
        # a state that can be gone on from holds the steps so far, which then are not in a file
        feeder = _node(args, settings) if args.ros else PipeFeeder(
            settings, ScoreLog(settings, spill=checkpoint is None))
        result = run_replay(
            args.logs, settings, feeder, output=args.output, start=args.start,
            duration=args.duration, checkpoint=checkpoint, warn=partial(_warn, args.prog))
    print(report(result))  # first: it is not lost where the JSON cannot be written
    if args.json:
        write_json(args.json, result.document())
    for path in filter(None, (args.output, args.json)):
        print(f'written   {path}')


def simulate(args: argparse.Namespace) -> None:
    """Run ``rovid simulate``."""
    from rovid_ros.commands.simulate import plan_trials, profile_warnings, simulate_log
    trials = plan_trials(args.output, args.duration, args.seed, args.profile or [{}])
    paths = [trial.path for trial in trials]
    check_written(paths, [args.params_file])
    settings = read_settings(args.params_file)
    with naming(args.params_file):
        warnings = [f'{trial.path}: {line}' for trial in trials
                    for line in profile_warnings(settings, args.duration, trial.profile)]
        for line in warnings:
            _warn(args.prog, line)
        for trial in trials:
            count = simulate_log(
                settings, trial.path, args.duration, trial.seed, trial.profile, trial.start)
            print(f'{trial.path}: {args.duration:,.1f} s, {count:,} messages, seed {trial.seed}')
    does = 'identify it with: rovid replay' if len(paths) == 1 else 'compare them: rovid compare'
    print(f'{does} {" ".join(map(str, paths))} --params-file {args.params_file}')


def tune(args: argparse.Namespace) -> None:
    """Run ``rovid tune``."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # as in compare
    from rovid_ros.commands.tune import tune_logs, tuned_document, tuned_text
    from rovid_ros.config.parameter_edit import edited
    from rovid_ros.files.whole_files import write_json, write_text
    check_written([args.output, args.json], [*args.logs, args.params_file])
    settings = read_settings(args.params_file, args.method)
    with naming(args.params_file):
        tuned = tune_logs(args.logs, settings, start=args.start, duration=args.duration,
                          warn=partial(_warn, args.prog))
    print(tuned_text(tuned))
    write_text(args.output, edited(args.params_file, tuned.changes()))
    read_settings(args.output)
    if args.json:
        write_json(args.json, tuned_document(tuned))
    for path in filter(None, (args.output, args.json)):
        print(f'written   {path}')


def plan(args: argparse.Namespace) -> None:
    """Run ``rovid plan``."""
    # many small steps: numpy's threads cost more than they give
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    from rovid_ros.commands.plan import as_csv, as_yaml, Asked, document, plan_text, propose
    from rovid_ros.files.whole_files import write_json, write_text
    from rovid_ros.results.identified import read_estimates
    if args.output and args.output.suffix not in ('.csv', '.yaml'):
        raise UsageError(f'--output: got {args.output}, takes a name that ends in .csv or .yaml')
    check_written([args.output, args.json],
                  list(filter(None, (args.estimates, args.params_file))))
    settings = read_settings(args.params_file)
    models = read_estimates(args.estimates) if args.estimates else []
    with naming(args.params_file):
        proposal = propose(settings, models, Asked(
            args.dofs, args.duration, args.max_force, args.max_speed, args.room, args.factor))
    for line in proposal.warnings:
        _warn(args.prog, line)
    print(plan_text(proposal, args.params_file))
    if args.output:
        write_text(args.output, as_csv(proposal, settings) if args.output.suffix == '.csv'
                   else as_yaml(proposal))
    if args.json:
        write_json(args.json, document(proposal))
    for path in filter(None, (args.output, args.json)):
        print(f'written   {path}')


def export(args: argparse.Namespace) -> None:
    """Run ``rovid export``."""
    from rovid_ros.files.whole_files import write_text
    from rovid_ros.results.export import export as made_from
    from rovid_ros.results.identified import read_estimates
    if args.link and args.format != 'sdf':
        raise UsageError('--link goes with --format sdf')
    check_written([args.output], list(filter(None, (args.estimates, args.params_file))))
    settings = read_settings(args.params_file) if args.params_file else None
    models = read_estimates(args.estimates, args.method, args.trained_on)
    made = made_from(models, args.format, args.estimates, settings=settings,
                     link=args.link or 'base_link')
    for line in made.notes:
        print(f'{args.prog}: {line}', file=sys.stderr)
    if args.output:
        write_text(args.output, made.text)
        print(f'written   {args.output}')
    else:
        print(made.text, end='')


def _node(args: argparse.Namespace, settings: Settings) -> Feeder:
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise CommandError(f'--ros needs ROS 2, which is not installed here: {error}') from None
    from rovid_ros.node.log_feeder import NodeFeeder
    try:
        return NodeFeeder(read_values(args.params_file, args.method), settings, args.rate)
    except RuntimeError as error:  # of rcl, such as for an impossible ROS_DOMAIN_ID
        raise CommandError(f'--ros: {error}') from None


def _warn(prog: str, line: str) -> None:
    print(f'{prog}: warning: {printable(line)}', file=sys.stderr)
