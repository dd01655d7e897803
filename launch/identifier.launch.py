"""Start the identifier: ``ros2 launch rovid_ros identifier.launch.py params_file:=FILE``."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

BOOLEAN = ['true', 'false']


def identifier(context: LaunchContext) -> list[Node]:
    """Return the node as the arguments say; refuse a file that launch would leave out."""
    given = {name: LaunchConfiguration(name).perform(context) for name in (
        'params_file', 'name', 'namespace', 'log_level', 'respawn', 'autostart', 'use_sim_time')}
    file = Path(given['params_file'])
    if not file.is_file():
        raise RuntimeError(f'params_file: {file}: there is no such file')
    over_the_file = {name: given[name] == 'true' for name in ('autostart', 'use_sim_time')
                     if given[name]}
    return [Node(
        package='rovid_ros', executable='identifier_node', name=given['name'],
        namespace=given['namespace'], parameters=[str(file), over_the_file],
        ros_arguments=['--log-level', given['log_level']],
        respawn=given['respawn'] == 'true', respawn_delay=2.0, output='screen')]


def generate_launch_description() -> LaunchDescription:
    """Return the node with its arguments."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'params_file', description='parameter file of the vehicle, see config/'),
        DeclareLaunchArgument(
            'name', default_value='identifier_node', description='name of the node'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of the node: its outputs and services, and those input '
            'topics whose names are relative (no slash in front)'),
        DeclareLaunchArgument(
            'log_level', default_value='info', choices=['debug', 'info', 'warn', 'error', 'fatal'],
            description='least severity of what is logged'),
        DeclareLaunchArgument(
            'respawn', default_value='false', choices=BOOLEAN,
            description='whether the node is started again 2 s after it has ended by itself'),
        DeclareLaunchArgument(
            'autostart', default_value='', choices=['', *BOOLEAN],
            description='whether the node configures and activates itself, or waits for '
            'ros2 lifecycle set; empty: as in the file'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false', choices=BOOLEAN,
            description='whether the time comes from /clock, as when a bag is played'),
        OpaqueFunction(function=identifier),
    ])
