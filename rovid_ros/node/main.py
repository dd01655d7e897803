"""The live node as a program; Ctrl-C is minded before anything slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
import sys

from rovid_ros.node.stop import Stop


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code."""
    stop = Stop()
    # these take half a second, in which Ctrl-C would give a traceback
    from rovid_ros.node.node import IdentifierNode
    from rovid_ros.node.process import run
    return run(IdentifierNode, sys.argv if arguments is None else arguments, stop)
