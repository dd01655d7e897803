"""
Installation by colcon (ament_python) and by pip.

``package.xml`` says name, version, description and license; they are read from there.
With ``ROVID_COMPILE=1`` in the environment mypyc compiles the modules of ``compiled_modules``.
"""

from glob import glob
import os
from pathlib import Path
import shutil
import sys
import sysconfig
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup

ROS_PACKAGES = (
    'diagnostic-msgs', 'geometry-msgs', 'lifecycle-msgs', 'nav-msgs', 'rcl-interfaces',
    'rclpy', 'rmw-fastrtps-cpp', 'rosgraph-msgs', 'sensor-msgs', 'std-msgs', 'std-srvs',
)
PLOTLY = 'plotly>=5.15'  # draws the HTML report; Debian has it as python3-plotly, rosdep not
DASK = 'distributed>=2022.2'  # rovid survey --scheduler
PARQUET = 'pyarrow>=8.0'  # rovid survey --output TABLE.parquet
PACKAGE = ElementTree.parse('package.xml').getroot()

COMPILE = os.environ.get('ROVID_COMPILE', '') not in ('', '0')
# Not on the way of a message, or not possible: mypyc compiles no exception, no class that inherits
# the attributes of a Protocol, and what it compiles has no subclass that is interpreted.
INTERPRETED = (
    'rovid_core/identify/method.py', 'rovid_core/settings/', 'rovid_core/simulation/',
    'rovid_core/trials/')
# Of rovid_ros and the score, what is on the way of a message to its estimate and to the file.
ALSO_COMPILED = (
    'rovid_core/trials/score.py', 'rovid_core/trials/spilling_table.py',
    'rovid_core/trials/tuning/log.py', 'rovid_ros/logs/log.py', 'rovid_ros/logs/mcap_writer.py',
    'rovid_ros/messages/converter.py', 'rovid_ros/results/dof_encoder.py',
    'rovid_ros/results/outputs.py', 'rovid_ros/results/wire_encoding.py')


def ros_wheels(distro: str) -> list[str]:
    """Return what stands in for ``apt install ros-<distro>-...`` where only pip is at hand."""
    return [f'ros-{distro}-{name}' for name in ROS_PACKAGES]


def manifest(tag: str) -> str:
    """Return the text of an element of ``package.xml`` on one line."""
    return ' '.join(PACKAGE.findtext(tag, '').split())


def compiled_modules() -> list[str]:
    """Return the files that are compiled."""
    return [*[path for path in sorted(glob('rovid_core/**/*.py', recursive=True))
              if not path.startswith(INTERPRETED)], *ALSO_COMPILED]


def extensions() -> list[Extension]:
    """Return what is to be compiled by this call of setup.py, nothing if it is not asked for."""
    if not COMPILE or not {'bdist_wheel', 'build', 'build_ext', 'develop', 'editable_wheel',
                           'install'} & set(sys.argv):
        return []
    if {'develop', 'editable_wheel'} & set(sys.argv):
        sys.exit('ROVID_COMPILE=1: an installation that is edited in place cannot be compiled, '
                 'for edits would have no effect; install without --editable, --symlink-install')
    compiler = (os.environ.get('CC') or sysconfig.get_config_var('CC') or 'cc').split()[0]
    if not shutil.which(compiler):
        sys.exit(f'ROVID_COMPILE=1: there is no C compiler {compiler!r}; install one (Debian: '
                 'gcc), or install without ROVID_COMPILE')
    header = Path(sysconfig.get_path('include'), 'Python.h')
    if not header.exists():
        sys.exit(f'ROVID_COMPILE=1: there is no {header}; install the headers of Python (Debian: '
                 'python3-dev), or install without ROVID_COMPILE')
    try:
        from mypyc.build import mypycify
    except ImportError:
        sys.exit(f'ROVID_COMPILE=1: {sys.executable} has no mypyc; pip install {COMPILERS[0]!r}')
    modules = mypycify(compiled_modules(), opt_level='3', group_name='rovid')
    for module in modules:
        # a fused multiply-add would round otherwise than Python does; and to look for warnings in
        # half a million lines that nobody wrote takes longer than to compile them
        module.extra_compile_args += ['-ffp-contract=off', '-Wno-all', '-Wno-error']
    return modules


COMPILERS = ['mypy==2.4.*', 'numpy>=1.21']  # numpy for its types

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
    ext_modules=extensions(),
    setup_requires=COMPILERS if COMPILE else [],
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
        'cluster': [DASK],
        'parquet': [PARQUET],
        'test': [
            'colcon-common-extensions', 'colcon-ros', 'hypothesis', 'mypy==2.4.*', PLOTLY,
            DASK, PARQUET, 'pytest', 'pytest-xdist', 'ruff==0.17.*',
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
