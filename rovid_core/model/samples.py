"""
The frozen values that go down the pipeline: samples and events, velocities, steps.

There are many of them: they are made several times faster than a frozen dataclass, and where they
are compiled their numbers are plain ones, which those of a tuple are not.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final, NamedTuple, TypeVar

from rovid_core.model.dofs import Three, Vector

NS: Final = 1e-9
"""[s] of a nanosecond, in which times are counted."""

Plain = TypeVar('Plain', bound='Values')


class Values:
    """Values by name, none of which is changed: what ``NAMES`` says ``__init__`` takes."""

    NAMES: ClassVar[tuple[str, ...]] = ()

    def fields(self) -> tuple[Any, ...]:
        """Return the values in their order."""
        return tuple([getattr(self, name) for name in self.NAMES])

    def replaced(self: Plain, **changes: Any) -> Plain:
        """Return the same with some other values."""
        return type(self)(**{**dict(zip(self.NAMES, self.fields())), **changes})

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and isinstance(other, Values) and (
            self.fields() == other.fields())

    def __hash__(self) -> int:
        return hash(self.fields())

    def __repr__(self) -> str:
        values = [f'{name}={value!r}' for name, value in zip(self.NAMES, self.fields())]
        return f'{type(self).__name__}({", ".join(values)})'


class Sample(Values):
    """
    What one input measured, in body FLU / world ENU and SI units.

    Attributes
    ----------
    input : str
        One of ``settings.INPUTS``.
    value : tuple of float
        position: x, y, z [m]; depth: z (up) [m]; attitude: quaternion x, y, z, w (body to
        world); angular_velocity: x, y, z [rad/s]; velocity: x, y, z [m/s]; reference: the
        linear then the angular velocity (6 values, NaN where there is none); thrusters and
        sign: one raw value per thruster, or the one value of thruster ``part``.
    part : int
        Index of the topic among ``thrusters.topics``.

    """

    NAMES: ClassVar[tuple[str, ...]] = ('input', 'value', 'part')

    def __init__(self, input: str, value: tuple[float, ...], part: int = 0) -> None:
        self.input = input
        self.value = value
        self.part = part


class Event(Values):
    """
    The samples that one message gave, at one event time.

    Attributes
    ----------
    time : int
        Event time [ns].
    samples : tuple of Sample
        In the order of ``settings.INPUTS``.
    origin : object
        What the event was made from; passed through untouched, for a recorder.

    """

    NAMES: ClassVar[tuple[str, ...]] = ('time', 'samples', 'origin')

    def __init__(self, time: int, samples: tuple[Sample, ...], origin: Any = None) -> None:
        self.time = time
        self.samples = samples
        self.origin = origin


class Motion(Values):
    """
    One measured velocity.

    Attributes
    ----------
    start, end : int
        The interval over which it is the mean [ns]; the same for a point measurement.
    time : int
        At which the velocity stands: the middle of the interval [ns].
    velocity : tuple of float
        One value per DOF of the source [m/s or rad/s], in the body frame.
    turn : float
        Angle by which the body turned since the interval before [rad].
    path_noise : tuple of float
        Standard deviation of the path over the interval that comes from the noise of the
        attitude [m or rad], one per DOF; empty where no attitude was used.
    body : Vector
        The velocity on all three axes of the body, also of DOFs that are not identified.
    fix : tuple of 2 floats
        Where the body was at the start of the interval, x and y in the world [m].

    """

    NAMES: ClassVar[tuple[str, ...]] = (
        'start', 'end', 'time', 'velocity', 'turn', 'path_noise', 'body', 'fix')

    def __init__(self, start: int, end: int, time: int, velocity: tuple[float, ...],
                 turn: float = 0.0, path_noise: tuple[float, ...] = (),
                 body: Vector = (0.0, 0.0, 0.0), fix: tuple[float, float] = (0.0, 0.0)) -> None:
        self.start = start
        self.end = end
        self.time = time
        self.velocity = velocity
        self.turn = turn
        self.path_noise = path_noise
        self.body = body
        self.fix = fix


class Step(Values):
    """
    What was measured over one step of one DOF.

    Attributes
    ----------
    dt : float
        Length of the step [s], above 0.
    velocity : tuple of 3 floats
        Filtered velocity at the start, the middle and the end [m/s or rad/s].
    force : tuple of 3 floats
        Force at the same points, filtered alike [N or N m]. The pipeline gives the exact mean
        over the step three times.
    mean : float
        What was measured, not filtered: the mean velocity over ``interval``, in whose middle
        the step ends, or the velocity at the step's end [m/s or rad/s].
    interval : float
        From the fix before the step's end to the fix after it [s]; 0 for a velocity sensor.
    parts : tuple of 2 floats
        Lengths of the step before and after the first of those fixes [s]; (dt, 0) for a
        velocity sensor.
    forces : tuple of 2 floats
        Exact mean of the force over each part, not filtered [N or N m].
    turn : float
        Angle by which the body turned since the interval before [rad].
    path_noise : float
        Standard deviation of the path over ``interval`` that comes from the noise of the
        attitude [m or rad].
    couplings : tuple of (float, float)
        Mean of each regressor of the DOF's couplings over the interval between fixes that each
        part lies in, not filtered; over the step, twice, for a velocity sensor.
    filtered_couplings : tuple of float
        The same over the step, filtered like the velocity.
    pieces : tuple of (float, float)
        Lengths of the pieces [s] in which the force is held over the step, and the force of
        each [N or N m]; empty where it is not held, or where the method has no use for it.
    watched : tuple of float
        Mean of each regressor that the method watches, over the interval that ends with the
        fix within the step, not filtered; 0 where it is not known.
    each : tuple of tuples of 3 floats
        Where the DOF's thrusters drive others, too: the means of ``EACH`` over each of the pieces,
        or over each part where there are none.

    """

    NAMES: ClassVar[tuple[str, ...]] = (
        'dt', 'velocity', 'force', 'mean', 'interval', 'parts', 'forces', 'turn', 'path_noise',
        'couplings', 'filtered_couplings', 'pieces', 'watched', 'each')

    def __init__(self, dt: float, velocity: Three, force: Three, mean: float = math.nan,
                 interval: float = 0.0, parts: tuple[float, float] = (0.0, 0.0),
                 forces: tuple[float, float] = (0.0, 0.0), turn: float = 0.0,
                 path_noise: float = 0.0, couplings: tuple[tuple[float, float], ...] = (),
                 filtered_couplings: tuple[float, ...] = (),
                 pieces: tuple[tuple[float, float], ...] = (),
                 watched: tuple[float, ...] = (), each: tuple[Three, ...] = ()) -> None:
        self.dt = dt
        self.velocity = velocity
        self.force = force
        self.mean = mean
        self.interval = interval
        self.parts = parts
        self.forces = forces
        self.turn = turn
        self.path_noise = path_noise
        self.couplings = couplings
        self.filtered_couplings = filtered_couplings
        self.pieces = pieces
        self.watched = watched
        self.each = each


class PlanarPiece(NamedTuple):
    """
    Where the body points over a part of a step.

    Attributes
    ----------
    surge_x, surge_y, sway_x, sway_y : float
        Horizontal parts of the body's axes, in the middle of that part.
    heave_x, heave_y : float
        Horizontal velocity that comes of the heave [m/s].
    rate : float
        Turning rate about the vertical axis of the body [rad/s].

    """

    surge_x: float
    surge_y: float
    sway_x: float
    sway_y: float
    heave_x: float
    heave_y: float
    rate: float

    def turned(self, angle: float) -> PlanarPiece:
        """Return it with the body turned on by an angle [rad]."""
        c, s = math.cos(angle), math.sin(angle)
        a, b, p, q, *rest = self
        return PlanarPiece(c * a + s * p, c * b + s * q, c * p - s * a, c * q - s * b, *rest)


class PlanarStart(NamedTuple):
    """
    What surge and sway go on from together.

    Attributes
    ----------
    velocity : tuple of 2 floats
        Of surge and sway over ground [m/s].
    axes : tuple of 4 floats
        Horizontal parts of the surge and the sway axis.
    gap : float
        [s] since the step before.

    """

    velocity: tuple[float, float]
    axes: tuple[float, float, float, float]
    gap: float = 0.0


class PlanarStep(NamedTuple):
    """
    What was measured over one step of surge and sway together; compare ``Step``.

    Attributes
    ----------
    dt : float
        Length of the step [s], above 0.
    velocity : tuple of 2 floats
        Filtered velocity over ground at the start [m/s].
    interval : float
        From the fix before the step's end to the fix after it [s]; 0 for a velocity sensor.
    parts : tuple of 2 floats
        Lengths of the step before and after the first of those fixes [s].
    forces : two tuples of 2 floats
        Exact mean of the force on surge and on sway over each part, not filtered [N].
    value : tuple of 2 floats
        That fix in the world [m], or the velocity over ground at the step's end [m/s].
    pieces : tuple of PlanarPiece
        Attitude over equal parts of the time from the measurement before to this one.
    axes : tuple of 4 floats
        Horizontal parts of the surge and the sway axis at the step's end.
    heading_noise : float
        Spectral density of the noise of the heading [rad^2 s].
    couplings : two tuples of floats
        Mean of each regressor of surge and of sway between the measurements, and behind them
        those that are watched, but not the heading.
    held : two tuples of (float, float)
        Lengths [s] of the pieces in which the force on surge and on sway is held, and the
        force of each [N]; compare ``Step.pieces``.
    each : two tuples of tuples of 3 floats
        Those of ``Step`` of surge and of sway.

    """

    dt: float
    velocity: tuple[float, float]
    interval: float
    parts: tuple[float, float]
    forces: tuple[tuple[float, float], tuple[float, float]]
    value: tuple[float, float]
    pieces: tuple[PlanarPiece, ...]
    axes: tuple[float, float, float, float]
    heading_noise: float = 0.0
    couplings: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    held: tuple[tuple[tuple[float, float], ...], ...] = ((), ())
    each: tuple[tuple[Three, ...], ...] = ((), ())


def equal_parts(start: int, end: int, count: int) -> list[tuple[int, int]]:
    """Return begin and end of so many equal parts of a span [ns]."""
    times = [start + (end - start) * k // count for k in range(count + 1)]
    return list(zip(times, times[1:]))


def finite(values: tuple[float, ...]) -> bool:
    """Tell whether all values are finite."""
    total = 0.0
    for x in values:
        total += x
    # most sums say at once that all are, whatever they round to
    return total - total == 0.0 or all(map(math.isfinite, values))
