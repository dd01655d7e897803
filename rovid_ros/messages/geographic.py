"""Latitude and longitude as metres east and north, on the ellipsoid of WGS 84."""

from __future__ import annotations

import math

SQUARED_ECCENTRICITY = 0.00669437999014
EQUATOR = 6378137.0  # [m] radius
GRID = 100.0  # [1/deg] of the origins that are taken


def metres_per_degree(latitude: float) -> tuple[float, float]:
    """Return how long a degree of latitude and one of longitude are at a latitude [deg]."""
    flat = 1.0 - SQUARED_ECCENTRICITY * math.sin(math.radians(latitude)) ** 2
    across = math.radians(EQUATOR / math.sqrt(flat))
    return (across * (1.0 - SQUARED_ECCENTRICITY) / flat,
            across * math.cos(math.radians(latitude)))


class LocalMetres:
    """
    Turn geographic positions into metres east, north and up of an origin near the first one.

    The origin is a round position, so that who begins somewhat later takes the same one.
    """

    def __init__(self) -> None:
        # latitude and longitude of the origin [deg], and how long a degree of each is there [m]
        self._origin: tuple[float, float, float, float] | None = None

    def __call__(self, latitude: float, longitude: float, altitude: float) -> tuple[
            float, float, float]:
        """Return east, north and up [m] of degrees and the altitude [m]; NaN for what is NaN."""
        if self._origin is None:
            if not math.isfinite(latitude + longitude):
                return (math.nan, math.nan, math.nan)
            near = round(latitude * GRID) / GRID
            self._origin = (near, round(longitude * GRID) / GRID, *metres_per_degree(near))
        parallel, meridian, north, east = self._origin
        turn = (longitude - meridian + 180.0) % 360.0 - 180.0
        return (east * turn, north * (latitude - parallel), float(altitude))
