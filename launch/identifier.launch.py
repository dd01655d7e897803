"""Start the identifier: ``ros2 launch rovid_ros identifier.launch.py params_file:=FILE``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Return the node with its arguments."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'params_file', description='parameter file of the vehicle, see config/'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of the node: its outputs and services, and those input '
            'topics whose names are relative (no slash in front)'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false',
            description='whether the time comes from /clock, as when a bag is played'),
        Node(
            package='rovid_ros',
            executable='identifier_node',
            namespace=LaunchConfiguration('namespace'),
            parameters=[
                LaunchConfiguration('params_file'),
                {'use_sim_time': ParameterValue(
                    LaunchConfiguration('use_sim_time'), value_type=bool)},
            ],
            output='screen',
        ),
    ])
