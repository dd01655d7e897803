"""The node as a process: command line, a clean end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
import sys
from typing import Any

import rclpy
from rclpy.exceptions import (
    NameValidationException,
    NoTypeSupportImportedException,
    ParameterException,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rovid_ros.commands.running import AT_FAULT, DONE, printable, USAGE, UsageError
from rovid_ros.node.lifecycle import one_line
from rovid_ros.node.parameters import NODE_NAME, read_files
from rovid_ros.node.stop import Stop
from rovid_ros.node.transport.wait import Wait


def run(make: Callable[[Mapping[str, Any]], Any], arguments: Sequence[str],
        stop: Stop) -> int:
    """
    Run a node until a signal.

    Parameters
    ----------
    make : callable
        Makes the node from the values of the parameter files.
    arguments : sequence of str
        Command line, the program's name first.
    stop : Stop
        Says when a signal came.

    Returns
    -------
    code : int
        0 after SIGINT or SIGTERM, 1 for a wrong configuration, 2 for a command line that
        cannot be read; both are told in one line.

    """
    if stop.asked:
        stop.ignore()
        return DONE
    try:
        rest, values = read_files(arguments)
        # what rcl has to say against the command line is said once, below
        set_logger_level('rcl', LoggingSeverity.FATAL)
        _parse(rest)
        # its own handlers would end the context before the last estimates are out
        rclpy.init(args=list(rest), signal_handler_options=SignalHandlerOptions.NO)
        set_logger_level('rcl', LoggingSeverity.UNSET)
        node = make(values)
    except (ValueError, OSError, RuntimeError, ParameterException, NameValidationException,
            NoTypeSupportImportedException) as error:
        print(f'{NODE_NAME}: {printable(one_line(error))}', file=sys.stderr)
        rclpy.try_shutdown()
        return USAGE if isinstance(error, UsageError) else AT_FAULT
    try:
        _spin(node, stop)
    finally:
        rclpy.try_shutdown()
    return DONE


def _parse(arguments: Sequence[str]) -> None:
    """Refuse what rcl cannot read, and all that is not its own but ``--help``."""
    try:
        rest = remove_ros_args(list(arguments))[1:]
    except RuntimeError as error:
        raise UsageError(one_line(error)) from None
    _, unknown = argparse.ArgumentParser(
        prog=NODE_NAME, usage='%(prog)s --ros-args --params-file FILE',
        description='Identifies the plant parameters of an underwater vehicle, live.',
    ).parse_known_args(rest)
    if unknown:
        raise UsageError(f'unknown arguments {unknown}; takes --ros-args --params-file FILE')


def _spin(node: Any, stop: Stop) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    woken = node.create_guard_condition(lambda: None)
    stop.wakes(woken.trigger)
    wait = Wait(node, executor)
    try:
        while not stop.asked:
            wait.turn()
    finally:
        stop.ignore()  # a second one must not break this off
        node.finish()
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
