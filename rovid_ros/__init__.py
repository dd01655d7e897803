"""Everything around ``rovid_core``: the ROS 2 node, recorded logs, configuration, commands."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version('rovid_ros')
except PackageNotFoundError:  # run from the source folder without an installation
    __version__ = 'unknown'
