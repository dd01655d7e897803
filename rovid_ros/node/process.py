"""The node as a process: its command line, its parameter files, its loop and a clean end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TYPE_CHECKING

import rclpy
from rclpy.exceptions import (
    NameValidationException,
    NoTypeSupportImportedException,
    ParameterException,
)
from rclpy.executors import Executor, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rovid_ros.commands.running import AT_FAULT, DONE, printable, tell, USAGE, UsageError
from rovid_ros.config.parameter_file import load, NODE_NAME
from rovid_ros.config.parameters import ROS_PARAMETERS
from rovid_ros.node.lifecycle import one_line

if TYPE_CHECKING:
    from rovid_ros.node.__main__ import StopRequest

FOR_EVER = -1
# Kinds of entities, in the order in which a wait set takes their numbers.
Kind = Literal['subscription', 'guard_condition', 'timer', 'client', 'service']


def run(make: Callable[..., Any], arguments: Sequence[str],
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
        node = make(values, is_stopped=lambda: stop.received)
    except (ValueError, OSError, RuntimeError, ParameterException, NameValidationException,
            NoTypeSupportImportedException) as error:
        if stop.received:  # which is why something is missing
            stop.ignore_signals()
            rclpy.try_shutdown()
            return DONE
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


class WaitLoop:
    """
    Waits until something is ready for a node, and runs it.

    It takes less than half the time per message of rclpy's executors, which collect, enter and
    check every entity of a node for each message, and then once more. This keeps one wait set
    instead and hands messages on the inputs straight to the node. All else (timers, services,
    parameters) is rare and is left to an executor.

    Besides the interface of rclpy's nodes it needs ``input_subscriptions``, and ``receive``,
    which processes all messages that wait on them.

    Events about quality of service are not waited for: the executor handles them whenever it
    runs, which it does at least with each of the node's timers.
    """

    def __init__(self, node: Any, executor: Executor) -> None:
        self._node = node
        self._executor = executor
        self._make_wait_set()

    def wait_and_run(self) -> None:
        """Wait until something is ready, and run all that is."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for add, handle in self._entities:
            add(handle)
        wait_set.wait(FOR_EVER)
        ready = set(wait_set.get_ready_entities('subscription'))
        if ready & self._inputs:
            self._node.receive()
        if ready - self._inputs or any(map(wait_set.get_ready_entities, self._others)):
            self._run_executor()
            self._make_wait_set()  # only the executor can make or destroy entities

    def _run_executor(self) -> None:
        """Let the executor run all that is ready."""
        try:
            while True:
                task, _, _ = self._executor.wait_for_ready_callbacks(0.0)
                task()
                task.result()  # raises what was raised
        except TimeoutException:  # nothing more is ready
            return

    def _make_wait_set(self) -> None:
        node = self._node
        kinds: dict[Kind, list[Any]] = {
            'subscription': [one.handle for one in node.subscriptions],
            'guard_condition': [one.handle for one in node.guards],
            'timer': [one.handle for one in node.timers],
            'client': [one.handle for one in node.clients],
            'service': [one.handle for one in node.services]}
        self._wait_set = wait_set = rclpy_implementation.WaitSet(  # type: ignore[call-arg]
            *map(len, kinds.values()), 0, node.context.handle)  # type: ignore[arg-type]
        self._entities = [(getattr(wait_set, f'add_{kind}'), handle)
                          for kind, handles in kinds.items() for handle in handles]
        self._others = [kind for kind, handles in kinds.items()
                        if handles and kind != 'subscription']
        self._inputs = {one.handle.pointer for one in node.input_subscriptions}
