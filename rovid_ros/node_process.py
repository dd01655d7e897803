"""The node as a process: command line, signals, a clean end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
import re
import signal
import sys
from types import FrameType
from typing import Any, Protocol

import rclpy
from rclpy.exceptions import (
    NameValidationException,
    NoTypeSupportImportedException,
    ParameterException,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rovid_ros.node_parameters import NODE_NAME, read_files

PATIENCE = 0.1
"""[s] A signal is noticed within this time."""


class Finishing(Protocol):
    """A node with an orderly end."""

    def finish(self) -> Any:
        """Send and write what is held."""


class Stop:
    """Turns SIGINT and SIGTERM into a flag."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def run(make: Callable[[Mapping[str, Any]], Any], arguments: Sequence[str]) -> int:
    """
    Run a node until a signal.

    Parameters
    ----------
    make : callable
        Makes the node from the values of the parameter files.
    arguments : sequence of str
        Command line, the program's name first.

    Returns
    -------
    code : int
        0 after SIGINT or SIGTERM, 1 for a wrong configuration, told in one line.

    """
    stop = Stop()
    try:
        rest, values = read_files(arguments)
        # what rcl has to say against the command line is said once, below
        set_logger_level('rcl', LoggingSeverity.FATAL)
        _parse(remove_ros_args(list(rest))[1:])
        # its own handlers would end the context before the last estimates are out
        rclpy.init(args=list(rest), signal_handler_options=SignalHandlerOptions.NO)
        set_logger_level('rcl', LoggingSeverity.UNSET)
        node = make(values)
    except (ValueError, OSError, RuntimeError, ParameterException, NameValidationException,
            NoTypeSupportImportedException) as error:
        print(f'{NODE_NAME}: {one_line(error)}', file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    try:
        _spin(node, stop)
    finally:
        rclpy.try_shutdown()
    return 0


def _parse(arguments: Sequence[str]) -> None:
    """Take nothing but ``--help``; ends the process with code 2 for anything else."""
    argparse.ArgumentParser(
        prog=NODE_NAME, usage='%(prog)s --ros-args --params-file FILE',
        description='Identifies the plant parameters of an underwater vehicle, live.',
    ).parse_args(arguments)


def one_line(error: Exception) -> str:
    """Return the text of an error without line breaks and rcl's own source lines."""
    text = ' '.join(str(error).split())
    if text.startswith("['"):
        text = f'unknown ROS arguments {text}'
    text = re.sub(r'^failed to initialize rcl: |^Failed to parse ROS arguments: ', '', text)
    return re.sub(r', at /\S+:\d+', '', text)


def _spin(node: Node, stop: Stop) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stop.asked:
            executor.spin_once(timeout_sec=PATIENCE)
    finally:
        # under a launch file SIGINT comes twice: the second must not break this off
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        node.finish()  # type: ignore[attr-defined]
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
