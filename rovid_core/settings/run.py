"""
Everything that a run depends on, as frozen values.

Each class refuses what cannot work with a :class:`SettingsError` that names the key as
it stands in the parameter file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any

from rovid_core.model.dofs import (
    ANGULAR_DOFS,
    coupling_prior,
    COUPLINGS,
    DOFS,
    Four,
    HEADING,
    LINEAR_DOFS,
    OWN,
    PARAMETERS,
    RESTORING,
    THRUSTS,
    velocity_factors,
)
from rovid_core.model.plant import lumped
from rovid_core.settings.inputs import InputSettings, SettingsError, ThrusterSettings

__all__ = [
    'INPUTS', 'CurrentSettings', 'DofSettings', 'IdentifierSettings', 'InputSettings', 'Scales',
    'Settings', 'SettingsError', 'SimulatedDof', 'SimulationSettings', 'ThrusterSettings',
]

INPUTS = (
    'position', 'depth', 'attitude', 'angular_velocity', 'velocity', 'reference', 'sign',
    'thrusters',
)
"""The inputs, in the order in which samples of one event time are taken."""

WATCHING = ('ekf',)
"""Methods that are given each step in detail, and look for what the model lacks."""

WITH_CURRENT = ('ekf',)
"""
Methods whose filters know the velocity, and that of the water: the others assume that it is still.
"""

LEAST_GAP = 1.0
"""[s] Least gap where ``max_gap`` follows the rates; no vehicle is slower than that."""

BURST = 10
"""
A fix that follows its predecessor this many times sooner than that one followed its own is of a
burst. Their difference is mostly noise, which the low-pass would weigh by the long interval.
"""

LEAST_WAIT = 0.1
"""[s] Least wait for the slowest input where ``max_wait`` follows what comes."""

MOST_WAIT = 60.0
"""[s] Largest ``max_wait``; what is further behind has another clock."""

TINY, HUGE = 1e-6, 1e12
"""What a mass, force or velocity can be in any unit; squares of it are far from overflow."""


@dataclass(frozen=True)
class IdentifierSettings:
    """The method and its gains; raw gains win over ``adaptation_time`` where given."""

    method: str = 'aid'
    integrator: str = 'heun'
    adaptation_time: float = 3.0
    feedback_gain: float = 0.0  # a of eq. 7 [1/s], negative; 0: from adaptation_time
    # the diagonal of Gamma: 4, or 4 per DOF, each followed by those of its couplings
    adaptation_gains: tuple[float, ...] = ()


@dataclass(frozen=True)
class CurrentSettings:
    """What is known of the horizontal current beforehand, on each axis of the world."""

    prior: float = 0.3  # standard deviation [m/s]; 0: the water is still
    change: float = 1.0e-5  # spectral density of its random walk [m^2/s^3]


@dataclass(frozen=True)
class DofSettings:
    """What is known or guessed of one degree of freedom beforehand."""

    mass: float
    quadratic_drag: float = 0.0
    linear_drag: float = 0.0
    bias: float = 0.0
    typical_force: float = 0.0  # 0: from the initial values
    typical_velocity: float = 0.0  # 0: 0.5
    dry_mass: float = 0.0  # 0: unknown
    terms: tuple[str, ...] = PARAMETERS
    couplings: tuple[str, ...] = ()  # of COUPLINGS


@dataclass(frozen=True, slots=True)
class Scales:
    """
    Typical size of things on one DOF, for normalised regressors and bounds.

    Attributes
    ----------
    force, velocity : float
        Typical force [N or N m] and velocity [m/s or rad/s], above 0.
    initial : tuple of 4 floats
        Initial lumped parameters, 0 for terms that are left out.
    active : tuple of 4 bools
        Terms that are identified.
    couplings : tuple of str
        Of the DOF, for methods that identify them.
    watched : tuple of str
        Other regressors that a method looks at, for what the model lacks.
    shares : bool
        Whether its thrusters drive other DOFs, too, so that steps say what each of them does.

    """

    force: float
    velocity: float
    initial: Four
    active: tuple[bool, bool, bool, bool]
    couplings: tuple[str, ...] = ()
    watched: tuple[str, ...] = ()
    shares: bool = False

    @staticmethod
    def of(settings: DofSettings) -> Scales:
        """
        Derive the scales from a DOF's settings.

        Without typical values: 0.5 m/s (rad/s), and the force that the initial model needs
        for that speed plus that for reaching it in 3 s.
        """
        active = tuple([name in settings.terms for name in PARAMETERS])
        values = lumped(
            settings.mass, settings.quadratic_drag, settings.linear_drag, settings.bias)
        initial = tuple([x if on else 0.0 for x, on in zip(values, active)])
        speed = settings.typical_velocity or 0.5
        force = settings.typical_force or (
            settings.mass * speed / 3.0
            + settings.quadratic_drag * speed * speed + settings.linear_drag * speed)
        return Scales(force, speed, initial, active,  # type: ignore[arg-type]
                      settings.couplings)

    @property
    def regressor(self) -> Four:
        """Return what the terms of phi = [tau, v|v|, v, 1] are multiplied by."""
        v = self.velocity
        return (1.0 / self.force, 1.0 / (v * v), 1.0 / v, 1.0)

    @property
    def coupling_regressor(self) -> tuple[float, ...]:
        """Return what the regressors of the couplings are multiplied by."""
        own, std = dict(zip(OWN, self.regressor)), self.coupling_std
        return tuple([own.get(x) or one / self._acceleration
                      for x, one in zip(self.couplings, std)])

    @property
    def coupling_std(self) -> tuple[float, ...]:
        """Return the standard deviations of the couplings before any data, in SI."""
        return self._std_of(self.couplings)

    @property
    def watched_std(self) -> tuple[float, ...]:
        """Return those that the watched regressors would have as couplings."""
        return self._std_of(self.watched)

    def _std_of(self, names: Sequence[str]) -> tuple[float, ...]:
        # what acts on reverse only may take as much of it as there is
        own = {name: self._acceleration * scale for name, scale in zip(OWN, self.regressor)}
        # and a force may have an arm of a metre, or the inverse of that
        own.update(dict.fromkeys(THRUSTS, self.initial[0]))
        return tuple([own.get(x) or coupling_prior(x) for x in names])

    @property
    def _acceleration(self) -> float:
        """Return a typical one."""
        return max(self.initial[0] * self.force, self.velocity / 3.0)

    def coupling_bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the lowest and the highest allowed couplings."""
        largest = [100.0 * std for std in self.coupling_std]
        return (tuple([-x for x in largest]), tuple([
            0.0 if name in RESTORING else x for name, x in zip(self.couplings, largest)]))

    def bounds(self) -> tuple[Four, Four]:
        """
        Return the lowest and the highest allowed parameters.

        alpha > 0, beta <= 0 and gamma <= 0 are physics; the outer limits only keep a
        wrong input from leading to infinity: alpha within a factor of 1000 of the initial
        one, and each other term at most 1000 times the initial acceleration or its initial
        value.
        """
        largest = 1000.0 * self._acceleration
        low: list[float] = []
        high: list[float] = []
        ranges = (
            (self.initial[0] / 1000.0, self.initial[0] * 1000.0),
            (-largest / self.velocity**2, 0.0),
            (-largest / self.velocity, 0.0),
            (-largest, largest),
        )
        for (bottom, top), start, on in zip(ranges, self.initial, self.active):
            low.append(min(bottom, start) if on else 0.0)
            high.append(max(top, start) if on else 0.0)
        return tuple(low), tuple(high)  # type: ignore[return-value]


@dataclass(frozen=True)
class SimulatedDof:
    """The truth of a simulated degree of freedom and the thrust that moves it."""

    mass: float
    quadratic_drag: float = 0.0
    linear_drag: float = 0.0
    bias: float = 0.0
    forces: tuple[float, ...] = ()  # amplitudes [N or N m] of the sinusoids
    frequencies: tuple[float, ...] = ()  # their frequencies [Hz]
    reverse_drag: float = 1.0  # quadratic drag astern relative to ahead
    disturbance: float = 0.0  # [N or N m] rms of a force that nobody knows


@dataclass(frozen=True)
class SimulationSettings:
    """Truth, sensor rates [Hz] and noise (one standard deviation) of a simulated run."""

    dofs: Mapping[str, SimulatedDof] = field(default_factory=dict)
    position_rate: float = 10.0
    position_noise: float = 0.005  # [m]
    depth_rate: float = 20.0
    depth_noise: float = 0.002  # [m]
    attitude_rate: float = 20.0
    attitude_noise: float = 0.002  # [rad]
    angular_velocity_rate: float = 50.0
    angular_velocity_noise: float = 0.002  # [rad/s]
    velocity_rate: float = 10.0  # also of the reference, which has no noise
    velocity_noise: float = 0.01  # [m/s]
    thruster_rate: float = 20.0
    thruster_noise: float = 0.0  # in the unit of the command
    publish_w: bool = False  # estimates carry W against these parameters
    coriolis: bool = False
    mass_matrix: tuple[float, ...] = ()  # 36 by rows; empty: the masses of the DOFs
    current: tuple[float, float] = (0.0, 0.0)  # of the water, x and y in the ENU world [m/s]
    current_turn: float = 0.0  # [s] in which it turns once; 0: it does not
    current_tide: float = 0.0  # [s] in which it comes and goes; 0: it does not
    righting: tuple[float, float] = (0.0, 0.0)  # roll, pitch [N m] at an angle of 90 degrees


@dataclass(frozen=True)
class Settings:
    """
    One run: inputs, measurement chain, identifier and the vehicle's degrees of freedom.

    Raises
    ------
    SettingsError
        If the settings contradict each other; it names the key.

    """

    dofs: tuple[str, ...]
    dof: Mapping[str, DofSettings]
    thrusters: ThrusterSettings
    position: InputSettings = InputSettings()
    depth: InputSettings = InputSettings()
    attitude: InputSettings = InputSettings()
    angular_velocity: InputSettings = InputSettings()
    velocity: InputSettings = InputSettings()
    reference: InputSettings = InputSettings()
    sign: InputSettings = InputSettings()
    hardware_id: str = ''  # '': the name of the node
    frames: str = 'enu'
    base_frame: str = 'base_link'  # frame_id of what is told in the body
    max_wait: float = -1.0  # [s]; below 0: as long as the inputs need
    max_gap: float = 0.0  # [s]; 0: by the rate of each input
    time_jump: float = 1.0
    enable: bool = True  # False: the parameters are frozen at the start
    reset_on_time_jump: bool = True
    depth_scale: float = 1.0
    depth_offset: float = 0.0
    yaw_offset: float = 0.0
    heading_unit: str = 'rad'
    heading_frames: str = ''  # '': as frames
    cutoff: float = 0.6
    max_speed: float = 10.0  # [m/s] or [rad/s]; faster measurements are refused
    gate: float = 8.0  # [std] of what is predicted of an input; 0: off
    relative_to: str = 'ground'  # what a measured velocity is relative to: ground | water
    identifier: IdentifierSettings = IdentifierSettings()
    current: CurrentSettings = CurrentSettings()
    simulation: SimulationSettings = SimulationSettings()
    record_path: str = ''
    # of one file of a record [bytes and s]; 0: any
    record_max_size: float = 0.0
    record_max_duration: float = 0.0
    checkpoint_path: str = ''
    checkpoint_period: float = 60.0
    autostart: bool = True  # of the live node: configured and activated by itself
    all_methods: bool = False  # steps carry what any method needs, not only the configured one

    def __post_init__(self) -> None:
        """Check that every DOF has what it needs."""
        if not self.dofs:
            raise SettingsError('dofs', f'takes one or more of {", ".join(DOFS)}')
        for dof in self.dofs:
            if dof not in DOFS:
                raise SettingsError('dofs', f'got {dof!r}, takes some of {", ".join(DOFS)}')
            if dof not in self.dof:
                raise SettingsError(f'{dof}.initial.mass', 'is required for a DOF in dofs')
        if len(set(self.dofs)) != len(self.dofs):
            raise SettingsError('dofs', 'names a DOF twice')
        if not self.thrusters.topics:
            raise SettingsError('thrusters.topic', 'is required')
        self._check_sources()
        self._check_gains()

    def source(self, dof: str) -> str:
        """Return the input that the DOF's velocity is measured by ('' if there is none)."""
        if dof in ANGULAR_DOFS:
            order: tuple[str, ...] = ('angular_velocity', 'attitude')
        elif dof == 'heave':
            order = ('velocity', 'depth', 'position')
        else:
            order = ('velocity', 'position')
        return next((name for name in order if self.input(name).topic), '')

    def input(self, name: str) -> InputSettings:
        """Return the settings of an input other than the thrusters."""
        found = getattr(self, name)
        assert isinstance(found, InputSettings)
        return found

    def frames_of(self, name: str) -> str:
        """Return the frames of an input's messages: ``enu`` or ``ned``."""
        return ('' if name == 'thrusters' else self.input(name).frames) or self.frames

    def needs(self, dof: str) -> tuple[str, ...]:
        """Return the inputs without which a DOF makes no step, its source first."""
        source = self.source(dof)
        turned = source in ('position', 'depth') and self.attitude.topic
        gyro = source == 'velocity' and any(self.velocity.lever_arm)
        needed = (source, 'attitude' if turned else '', 'angular_velocity' if gyro else '',
                  'sign', 'thrusters')
        return tuple(name for name in needed if name in self.used_inputs())

    def largest_age(self, dof: str) -> float:
        """Return how old [s] a DOF's last step may be: the longest timeout of its sensors."""
        return max(self.timeout_of(name) for name in self.needs(dof)
                   if name not in ('sign', 'thrusters'))

    def couplings(self, dof: str) -> tuple[str, ...]:
        """Return the couplings of a DOF."""
        return self.dof[dof].couplings

    @property
    def watches(self) -> bool:
        """Tell whether steps carry pieces of the force, noise of the path, what is watched."""
        return self.all_methods or self.identifier.method in WATCHING

    def possible_couplings(self, dof: str) -> tuple[str, ...]:
        """Return the couplings of a DOF whose velocities, angles and forces are known."""
        sources = {self.source(d) for d in self.dofs}
        linear = 'velocity' if self.velocity.topic else 'position'
        known = set(LINEAR_DOFS) if linear in sources else set()
        if self.attitude.topic or 'angular_velocity' in sources:
            known |= set(ANGULAR_DOFS)
        return tuple([name for name in COUPLINGS[dof] if name not in OWN and (
            bool(self.attitude.topic) if name in RESTORING
            else THRUSTS[name] in self.dofs if name in THRUSTS
            else set(velocity_factors(name)) <= known)])

    def watched(self, dof: str) -> tuple[str, ...]:
        """Return the regressors that a DOF does not have and its method watches."""
        if not self.watches:
            return ()
        turns = self.attitude.topic and dof in ('surge', 'sway')
        named = (*self.possible_couplings(dof), *(HEADING if turns else ()))
        return tuple([name for name in named if name not in self.couplings(dof)])

    @property
    def sharing(self) -> tuple[str, ...]:
        """Return the DOFs whose thrusters drive others, too, where the method watches them."""
        numbers = [DOFS.index(dof) for dof in self.dofs]
        return tuple([dof for dof, i in zip(self.dofs, numbers)
                      if self.watches and self.thrusters.shares(i, numbers)])

    @property
    def sees_current(self) -> bool:
        """
        Tell whether a current of the water shows in what is measured.

        It takes surge or sway over ground, and an attitude to turn the current by.
        """
        over_ground = {'position'} | ({'velocity'} if self.relative_to == 'ground' else set())
        return bool(self.current.prior and self.attitude.topic) and any(
            self.source(dof) in over_ground for dof in self.dofs if dof in ('surge', 'sway'))

    @property
    def estimates_current(self) -> bool:
        """Tell whether the method estimates the current of the water."""
        return self.identifier.method in WITH_CURRENT and self.sees_current

    def raw_gains(self, dof: str) -> tuple[float, ...] | None:
        """Return the diagonal of Gamma of a DOF, None where there are no raw gains."""
        gains = self.identifier.adaptation_gains
        if not gains:
            return None
        counts = [4 + len(self.couplings(name)) for name in self.dofs]
        if len(gains) != sum(counts):
            return gains
        i = self.dofs.index(dof)
        start = sum(counts[:i])
        return gains[start:start + counts[i]]

    def timeout_of(self, name: str) -> float:
        """Return after how long [s] an input counts as silent; infinite for held thrust."""
        if name == 'thrusters':
            return self.thrusters.timeout or math.inf
        return self.input(name).timeout or self.max_gap or LEAST_GAP

    def with_timeouts(self, timeouts: Mapping[str, float]) -> Settings:
        """Return the same settings with other timeouts [s] of some inputs, by their names."""
        inputs: dict[str, Any] = {
            name: replace(self.input(name), timeout=timeout) for name, timeout in timeouts.items()}
        return replace(self, **inputs)

    def latencies(self) -> dict[str, float]:
        """Return the latency [s] of each input that has a topic."""
        return {name: (self.thrusters if name == 'thrusters' else self.input(name)).latency
                for name in self.used_inputs()}

    @property
    def wait(self) -> float:
        """
        Return how long [s] the inputs wait for the slowest one at first.

        What comes with a latency has event times that lie back by it.
        """
        if self.max_wait >= 0.0:
            return self.max_wait
        latencies = self.latencies().values()
        return LEAST_WAIT + max(latencies) - min(latencies)

    @property
    def longest_timeout(self) -> float:
        """Return how far back [s] the measurements may reach that a step is made of."""
        return max(self.max_gap or LEAST_GAP, *(
            self.timeout_of(name) for name in self.used_inputs() if name != 'thrusters'))

    def used_inputs(self) -> tuple[str, ...]:
        """Return the names of the inputs that have a topic, in the order of ``INPUTS``."""
        return tuple(
            name for name in INPUTS if name == 'thrusters' or self.input(name).topic)

    def _check_sources(self) -> None:
        for dof in self.dofs:
            if not self.source(dof):
                needs = ('attitude.topic or angular_velocity.topic' if dof in ANGULAR_DOFS
                         else 'depth.topic, position.topic or velocity.topic'
                         if dof == 'heave' else 'position.topic or velocity.topic')
                raise SettingsError('dofs', f'{dof} needs {needs}')
        horizontal = [d for d in self.dofs if d in LINEAR_DOFS and self.source(d) == 'position']
        if horizontal and not self.attitude.topic:
            raise SettingsError(
                'attitude.topic', f'is required: {horizontal[0]} is measured in the world frame '
                                  'and has to be turned into the body frame')
        if any(self.velocity.lever_arm) and self.velocity.topic and (
                not self.angular_velocity.topic):
            raise SettingsError('velocity.lever_arm', 'needs angular_velocity.topic: what the '
                                                      'turning adds there is taken off')

    def _check_gains(self) -> None:
        count = len(self.identifier.adaptation_gains)
        # every coupling has a gain; 4 numbers are for every DOF, where there are none
        own = sum(4 + len(self.couplings(name)) for name in self.dofs)
        if count not in (0, own, 4 if own == 4 * len(self.dofs) else own):
            raise SettingsError(
                'identifier.adaptation_gains', 'takes ' + (
                    f'4 numbers, or 4 per DOF = {own}' if own == 4 * len(self.dofs) else
                    f'4 numbers per DOF and one per coupling of aid = {own}') + f', got {count}')
        if bool(count) != (self.identifier.feedback_gain != 0.0):
            raise SettingsError(
                'identifier.feedback_gain', 'and identifier.adaptation_gains go together')
        for name in self.dofs:
            self._check_dof(name)
            self._check_couplings(name)
            terms = self.dof[name].terms
            unknown = [t for t in terms if t not in PARAMETERS]
            if unknown:
                raise SettingsError(
                    f'{name}.terms', f'got {unknown[0]!r}, takes {", ".join(PARAMETERS)}')
            if 'alpha' not in terms:
                raise SettingsError(f'{name}.terms', 'alpha always stays')

    def _check_couplings(self, name: str) -> None:
        couplings = self.dof[name].couplings
        for coupling in couplings:
            if coupling not in COUPLINGS[name]:
                raise SettingsError(
                    f'{name}.couplings', f'got {coupling!r}, takes {", ".join(COUPLINGS[name])}')
        if len(set(couplings)) != len(couplings):
            raise SettingsError(f'{name}.couplings', 'names one twice')
        moving = {dof for coupling in couplings for dof in velocity_factors(coupling)}
        if moving & set(LINEAR_DOFS) and not (self.position.topic or self.velocity.topic):
            raise SettingsError(f'{name}.couplings', 'needs position.topic or velocity.topic')
        if moving & set(ANGULAR_DOFS) and not (self.attitude.topic or self.angular_velocity.topic):
            raise SettingsError(
                f'{name}.couplings', 'needs attitude.topic or angular_velocity.topic')
        if set(RESTORING) & set(couplings) and not self.attitude.topic:
            raise SettingsError(f'{name}.couplings', 'needs attitude.topic')
        for coupling in couplings:
            if coupling in THRUSTS and THRUSTS[coupling] not in self.dofs:
                raise SettingsError(
                    f'{name}.couplings', f'{coupling} needs {THRUSTS[coupling]} in dofs')

    def _check_dof(self, name: str) -> None:
        dof = self.dof[name]
        for key, value, lowest in (
                ('initial.mass', dof.mass, TINY),
                ('initial.quadratic_drag', dof.quadratic_drag, 0),
                ('initial.linear_drag', dof.linear_drag, 0),
                ('typical.force', dof.typical_force or 1.0, TINY),
                ('typical.velocity', dof.typical_velocity or 1.0, TINY)):
            if not lowest <= value < HUGE:
                raise SettingsError(
                    f'{name}.{key}', f'got {value:g}, takes a number from {lowest:g} to {HUGE:g}')
        if not abs(dof.bias) < HUGE:
            raise SettingsError(f'{name}.initial.bias', f'got {dof.bias:g}, is too large')
