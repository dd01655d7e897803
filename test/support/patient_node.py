"""The node without its rule for overload: for messages that are sent as fast as it takes them."""

from math import inf
import sys

from rovid_ros.node.__main__ import main
import rovid_ros.node.transport.inputs

if __name__ == '__main__':
    rovid_ros.node.transport.inputs.LATE = inf
    sys.exit(main())
