"""Where the configurations are that come with rovid."""

from __future__ import annotations

from pathlib import Path
import sys

from rovid_ros.config.parameter_file import ParameterFileError


def shipped_file(name: str) -> Path:
    """
    Return a file of ``config/``, of the checkout or of the installation.

    Parameters
    ----------
    name : str
        Such as ``jhurov.yaml`` or ``examples/auv.yaml``.

    Raises
    ------
    ParameterFileError
        If it is nowhere.

    """
    here = Path(__file__).resolve()
    places = [here.parents[2] / 'config' / name]
    places += [up / 'share' / 'rovid_ros' / 'config' / name
               for up in (*here.parents, Path(sys.prefix))]
    for place in places:
        if place.is_file():
            return place
    raise ParameterFileError(f'{name} is neither at {places[0]} nor in share/rovid_ros/config of '
                             'the installation')
