"""The node as a process: its command line, its parameter files and a clean end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

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
from rovid_ros.commands.running import AT_FAULT, DONE, printable, tell, USAGE, UsageError
from rovid_ros.config.parameter_file import load, NODE_NAME
from rovid_ros.config.parameters import ROS_PARAMETERS
from rovid_ros.node.lifecycle import one_line
from rovid_ros.node.transport.wait import WaitLoop

if TYPE_CHECKING:
    from rovid_ros.node.__main__ import StopRequest


def run(make: Callable[[Mapping[str, Any]], Any], arguments: Sequence[str],
        stop: StopRequest) -> int:
    """
    Run a node until a signal comes, and return the exit code.

    It is 0 after SIGINT or SIGTERM, 1 for a wrong configuration or where the last state could not
    be saved, 2 for a command line that cannot be read. An error is printed as one line.
    """
    if stop.received:
        stop.ignore_signals()
        return DONE
    try:
        rest, values = read_files(arguments)
        # rcl would log its complaints about the command line too; they are printed below
        set_logger_level('rcl', LoggingSeverity.FATAL)
        _check_arguments(rest)
        # rclpy's own handlers would end the context before the last estimates are out
        rclpy.init(args=list(rest), signal_handler_options=SignalHandlerOptions.NO)
        set_logger_level('rcl', LoggingSeverity.UNSET)
        node = make(values)
    except (ValueError, OSError, RuntimeError, ParameterException, NameValidationException,
            NoTypeSupportImportedException) as error:
        tell(f'{NODE_NAME}: {printable(one_line(error))}')
        rclpy.try_shutdown()
        return USAGE if isinstance(error, UsageError) else AT_FAULT
    try:
        _spin(node, stop)
    finally:
        rclpy.try_shutdown()
    return DONE if node.saved else AT_FAULT


def read_files(arguments: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """
    Read the parameter files of the command line with the reader that all commands use.

    rcl's own reader turns an empty list into nothing, dies of a list with integers and
    doubles, and names neither file nor key in its errors.

    Returns
    -------
    rest : list of str
        The command line without the parameter files; the parameters that rclpy itself
        declares come first, as ``-p`` arguments.
    values : dict
        The other parameters of the files by dotted key; a later file wins.

    Raises
    ------
    ParameterFileError
        If a file cannot be read; the error names file and line.

    """
    rest, files = _split_off_files(arguments)
    name, namespace = _full_name(rest)
    values: dict[str, Any] = {}
    for file in files:
        values.update(load(file, name, namespace))
    # as overrides given to the node these would win over the command line
    own = [key for key, value in values.items()
           if ROS_PARAMETERS.fullmatch(key) and isinstance(value, bool)]
    if own:
        rest[1:1] = ['--ros-args', *(word for key in own for word in (
            '-p', f'{key}:={str(values.pop(key)).lower()}')), '--']
    return rest, values


def _split_off_files(arguments: Sequence[str]) -> tuple[list[str], list[Path]]:
    """Return the arguments without ``--params-file FILE``, and those files."""
    rest: list[str] = []
    files: list[Path] = []
    in_ros = False
    tokens = iter(arguments)
    for token in tokens:
        if token in ('--ros-args', '--'):
            in_ros = token == '--ros-args'
        if in_ros and token == '--params-file':
            file = next(tokens, None)
            if file is not None:
                files.append(Path(file))
                continue
        rest.append(token)
    return rest, files


def _full_name(arguments: Sequence[str]) -> tuple[str, str]:
    """Return name and namespace of the node after the remapping rules."""
    name, namespace = NODE_NAME, '/'
    for flag, rule in zip(arguments, arguments[1:]):
        if flag not in ('-r', '--remap'):
            continue
        source, _, target = rule.removeprefix(f'{NODE_NAME}:').partition(':=')
        if source in ('__node', '__name'):
            name = target
        elif source == '__ns':
            namespace = f'/{target.strip("/")}'
    return name, namespace


def _check_arguments(arguments: Sequence[str]) -> None:
    """Refuse what rcl cannot read, and every argument besides rcl's own and ``--help``."""
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


def _spin(node: Any, stop: StopRequest) -> None:
    """Run the node until a signal comes, then finish and destroy it."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    woken = node.create_guard_condition(lambda: None)
    stop.call_on_signal(woken.trigger)
    loop = WaitLoop(node, executor)
    try:
        while not stop.received:
            loop.wait_and_run()
    finally:
        stop.ignore_signals()  # a second one must not interrupt the end
        node.finish()
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
