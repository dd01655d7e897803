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
        self._is_known = False
        self._latitude = self._longitude = self._north = self._east = 0.0

    def __call__(self, latitude: float, longitude: float, altitude: float) -> tuple[
            float, float, float]:
        """Return east, north and up [m] of degrees and the altitude [m]; NaN for what is NaN."""
        if not self._is_known:
            if not math.isfinite(latitude + longitude):
                return (math.nan, math.nan, math.nan)
            self._latitude = round(latitude * GRID) / GRID
            self._longitude = round(longitude * GRID) / GRID
            self._north, self._east = metres_per_degree(self._latitude)
            self._is_known = True
        turn = (longitude - self._longitude + 180.0) % 360.0 - 180.0
        return (self._east * turn, self._north * (latitude - self._latitude), float(altitude))
