"""A node that makes an array of each position, and does nothing else: the yardstick of load."""

from __future__ import annotations

import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rovid_ros.node.__main__ import StopRequest
from rovid_ros.node.process import read_files
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.node.transport.publishers import best_effort, DEPTH, reliable
from std_msgs.msg import Float64MultiArray


def main() -> None:
    """Run until SIGINT."""
    stop = StopRequest()
    arguments, values = read_files(sys.argv)
    rclpy.init(args=arguments, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = rclpy.create_node('pass_through')
    publisher = node.create_publisher(Float64MultiArray, 'rov/params', reliable(DEPTH))
    message = Float64MultiArray(data=[0.0] * 16)
    for name in ('position', 'depth', 'attitude', 'thrusters'):
        if not values.get(f'{name}.topic'):
            continue

        def take(received: object, name: str = name) -> None:
            if name == 'position':
                publisher.publish(message)

        node.create_subscription(import_type(values[f'{name}.type']), values[f'{name}.topic'],
                                 take, best_effort(DEPTH))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.received:
        executor.spin_once(timeout_sec=0.1)
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
