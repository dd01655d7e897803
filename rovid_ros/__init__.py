"""Everything around ``rovid_core``: the ROS 2 node, recorded logs, configuration, commands."""


def __getattr__(name: str) -> str:
    """Look the version up when it is asked for, which takes as long as all of ``--help``."""
    if name != '__version__':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from importlib.metadata import PackageNotFoundError, version
    try:
        return version('rovid_ros')
    except PackageNotFoundError:  # run from the source folder without an installation
        return 'unknown'


def build() -> str:
    """Return the version and how it was installed: ``(compiled)`` or ``(pure Python)``."""
    from rovid_core import COMPILED
    return f'{__getattr__("__version__")} ({"compiled" if COMPILED else "pure Python"})'
