"""
Installation by colcon (ament_python) and by pip.

``package.xml`` says name, version, description and license; they are read from there.
"""

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

ROS_PACKAGES = (
    'diagnostic-msgs', 'geometry-msgs', 'lifecycle-msgs', 'nav-msgs', 'rcl-interfaces',
    'rclpy', 'rmw-fastrtps-cpp', 'rosgraph-msgs', 'sensor-msgs', 'std-msgs', 'std-srvs',
)
PLOTLY = 'plotly>=5.15'  # draws the HTML report; Debian has it as python3-plotly, rosdep not
PACKAGE = ElementTree.parse('package.xml').getroot()


def ros_wheels(distro: str) -> list[str]:
    """Return what stands in for ``apt install ros-<distro>-...`` where only pip is at hand."""
    return [f'ros-{distro}-{name}' for name in ROS_PACKAGES]


def manifest(tag: str) -> str:
    """Return the text of an element of ``package.xml`` on one line."""
    return ' '.join(PACKAGE.findtext(tag, '').split())


name = manifest('name')
share = f'share/{name}'
readme = Path('README.md')  # not there in the build space of colcon's symlink install

setup(
    name=name,
    version=manifest('version'),
    description=manifest('description'),
    long_description=readme.read_text(encoding='utf8') if readme.exists() else '',
    long_description_content_type='text/markdown',
    license=manifest('license'),
    maintainer=manifest('maintainer'),
    maintainer_email=PACKAGE.find('maintainer').attrib['email'],
    packages=find_packages(include=['rovid_*']),
    package_data={f'{name}.report': ['page/*']},  # style and script of the HTML report
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{name}']),
        (share, ['package.xml']),
        (f'{share}/environment', ['resource/path.dsv']),  # colcon.pkg: puts rovid on PATH
        (f'{share}/config', sorted(glob('config/*.yaml') + glob('config/*_layout.*')
                                     + glob('config/sros2_*.xml'))),
        (f'{share}/config/examples', sorted(glob('config/examples/*.yaml'))),
        (f'{share}/launch', sorted(glob('launch/*.launch.py'))),
    ],
    python_requires='>=3.10',
    install_requires=[
        'lz4>=4.0', 'mcap>=1.5', 'numpy>=1.21', 'PyYAML>=6.0', 'rosbags>=0.10.9',
        'scipy>=1.8', 'zstandard>=0.20',
    ],
    extras_require={
        'ros': ros_wheels('kilted'),
        'kilted': ros_wheels('kilted'),
        'jazzy': ros_wheels('jazzy'),
        'report': [PLOTLY],
        'test': [
            'colcon-common-extensions', 'colcon-ros', 'hypothesis', 'mypy==2.4.*', PLOTLY,
            'pytest', 'pytest-xdist', 'ruff==0.17.*',
            'setuptools<80',  # the last with the commands that colcon calls
            'scipy-stubs', 'types-PyYAML',
        ],
    },
    entry_points={
        'console_scripts': [
            'identifier_node = rovid_ros.node.__main__:main',
            'rovid = rovid_ros.commands.main:main',
        ],
    },
    zip_safe=False,
)
