"""
Which way is up: what an accelerometer and the depth say of the configured frames.

Frames that are wrong throughout contradict no motion: masses stay, and the signs of the biases of
sway, heave and yaw turn.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rovid_core.model.samples import NS
from rovid_core.settings.run import Settings

LEAST = 7.0  # [m/s^2] of gravity along z, or the body does not stand upright
STEP = 2.0  # [s] over which means are compared
EVERY = 100_000_000  # [ns] more often nothing is kept
FEWEST, STILL, ALIKE = 20, 0.02, 0.5  # steps, [m/s], correlation


class Upwards:
    """What messages and samples say of it, in one pass."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._gravity: dict[str, tuple[int, float]] = {}  # by topic: count and sum [m/s^2]
        # [ns] and height [m], or velocity upwards [m/s] in the body
        self._tracks: dict[str, list[tuple[int, float]]] = {'depth': [], 'velocity': []}

    def add_message(self, topic: str, message: Any) -> None:
        """Add a message as it came."""
        z = getattr(getattr(message, 'linear_acceleration', None), 'z', None)
        if isinstance(z, float):
            count, total = self._gravity.get(topic, (0, 0.0))
            self._gravity[topic] = count + 1, total + z

    def add_sample(self, name: str, time: int, value: tuple[float, ...]) -> None:
        """Add a sample, in body FLU and world ENU."""
        track = self._tracks.get(name)
        if track is not None and (not track or time >= track[-1][0] + EVERY):
            track.append((time, value[-1]))

    def warnings(self) -> list[tuple[str, str, str]]:
        """Return subject, finding and advice of what is upside down."""
        found = []
        for topic, (count, total) in self._gravity.items():
            mean = total / count
            frames = 'ned' if mean < 0.0 else 'enu'
            wrong = [name for name in ('attitude', 'angular_velocity')
                     if self._settings.input(name).topic == topic
                     and self._settings.frames_of(name) != frames]
            if wrong and abs(mean) > LEAST:
                found.append((
                    wrong[0], f'the accelerometer of {topic} sees {mean:+.1f} m/s^2 in z, as '
                    f'with frames: {frames}, but they are {self._settings.frames_of(wrong[0])}',
                    'with wrong ones sway, heave and yaw and their biases have the wrong sign'))
        alike = self._correlation()
        if alike < -ALIKE:
            found.append(('velocity', 'its z moves against the depth (correlation '
                          f'{alike:.2f})', 'frames, or the sign of depth.scale, is wrong'))
        return found

    def _correlation(self) -> float:
        """Return that of how fast the depth and the velocity rise, 0 where they do not tell."""
        if not all(self._tracks.values()):
            return 0.0
        (times, heights), (others, speeds) = [
            np.array(track).T * np.array([[NS], [1.0]]) for track in self._tracks.values()]
        steps = np.arange(max(times[0], others[0]), min(times[-1], others[-1]), STEP)
        ways = np.cumsum(np.diff(others, prepend=others[0]) * speeds)
        rates = [np.diff(np.interp(steps, *track)) / STEP
                 for track in ((times, heights), (others, ways))]
        if len(steps) <= FEWEST or min(map(np.std, rates)) < STILL:
            return 0.0
        return float(np.corrcoef(*rates)[0, 1])
