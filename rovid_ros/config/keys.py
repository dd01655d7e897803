"""All parameters (``KEYS``): name, type, default, unit, range and meaning of each."""

from __future__ import annotations

from dataclasses import dataclass, fields, MISSING
from functools import partial
from typing import Any

from rovid_core.identify import METHODS
from rovid_core.model.dofs import COUPLINGS, DOFS, LINEAR_DOFS, PARAMETERS, PHYSICAL
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)

LARGE = 1e12  # bound of a number that needs none; it still keeps NaN and infinity out

# type, size and default of a key by the annotation of its setting
_TYPES: dict[str, tuple[str, int, Any]] = {
    'float': ('double', 0, 0.0),
    'bool': ('bool', 0, False),
    'str': ('string', 0, ''),
    'tuple[float, ...]': ('double[]', 0, ()),
    'tuple[float, float]': ('double[]', 2, ()),
    'tuple[float, float, float]': ('double[]', 3, ()),
    'tuple[str, ...]': ('string[]', 0, ()),
    'tuple[tuple[float, ...], ...]': ('double[]', 0, ()),
}


@dataclass(frozen=True)
class Key:
    """One parameter."""

    name: str  # as in the parameter file, dotted: ``thrusters.gain``
    setting: str  # where its value goes in :class:`rovid_core.settings.run.Settings`, dotted
    type: str  # double, bool, string, double[] or string[]
    default: Any  # its value when it is not given
    description: str  # what it means
    unit: str = ''  # unit, '' if it has none
    # range of a number, or of each number of an array
    low: float = -LARGE
    high: float = LARGE
    choices: tuple[str, ...] = ()  # the texts that it takes; none: any
    size: int = 0  # number of entries of an array; 0: any
    live: bool = False  # whether the node takes another value while it runs

    @property
    def takes(self) -> str:
        """Return what the key takes, to end a sentence with."""
        unit = f' [{self.unit}]' if self.unit else ''
        bounds = ''
        if (self.low, self.high) != (-LARGE, LARGE):
            bounds = f' from {self.low:g} to {self.high:g}'
        count = f'{self.size} ' if self.size else ''
        return {
            'double': f'a number{bounds}{unit}',
            'bool': 'true or false',
            'string': 'one of ' + ', '.join(repr(c) for c in self.choices) if self.choices
                      else 'text',
            'double[]': f'a list of {count}numbers{bounds}{unit}',
            'string[]': 'a list of ' + (', '.join(self.choices) if self.choices else 'texts'),
        }[self.type]


def key_of(name: str, setting: str, owner: type, description: str, unit: str = '',
           low: float = -LARGE, high: float = LARGE, choices: tuple[str, ...] = (),
           live: bool = False) -> Key:
    """Return the key of a setting, with the type and default of the owner's field."""
    field = {f.name: f for f in fields(owner)}[setting.rpartition('.')[2]]
    kind, size, default = _TYPES[str(field.type)]
    if field.default is not MISSING:
        default = field.default
    return Key(name, setting, kind, default, description, unit, low, high, choices, size, live)


def in_group(group: str, owner: type, name: str, description: str, unit: str = '',
             low: float = -LARGE, high: float = LARGE, choices: tuple[str, ...] = (),
             live: bool = False) -> Key:
    """Return the key of a setting that has the same name in the file as in the settings."""
    dotted = f'{group}.{name}'
    return key_of(dotted, dotted, owner, description, unit, low, high, choices, live)


def _source(name: str, setting: str, what: str, owner: type = InputSettings) -> list[Key]:
    """Return the keys that say where an input comes from."""
    topic = 'topics' if owner is ThrusterSettings else 'topic'
    timeout = [] if owner is ThrusterSettings else [key_of(
        f'{name}.timeout', f'{setting}.timeout', owner,
        'silent for longer it starts anew, and what needs it waits no more; 0: max_gap', 's',
        0.0, 3600.0)]
    return [
        key_of(f'{name}.{topic}', f'{setting}.{topic}', owner, what),
        key_of(f'{name}.type', f'{setting}.type', owner,
               'message type, package/msg/Type; a log knows its own'),
        key_of(f'{name}.field', f'{setting}.field', owner,
               'field path in the message, dotted, with [i] for an index, or several with commas; '
               'empty: all of it'),
        key_of(f'{name}.stamp', f'{setting}.stamp', owner,
               'time of the data: header stamp or receive time; empty: header where there is one',
               choices=('', 'header', 'receive')),
        key_of(f'{name}.latency', f'{setting}.latency', owner,
               'time between the measurement and its stamp, subtracted', 's', -10.0, 10.0),
        key_of(f'{name}.qos', f'{setting}.qos', owner,
               'quality of service of the live subscription: sensor_data hears every publisher, '
               'transient_local also what was published before',
               choices=('sensor_data', 'reliable', 'transient_local')),
        *timeout,
    ]


def _mounted(name: str) -> list[Key]:
    """Return the keys that say how a sensor of the body is turned in it."""
    return [
        key_of(f'{name}.frames', f'{name}.frames', InputSettings,
               'frames of these messages, such as ned for a DVL with z down and y to the right; '
               'empty: as frames', choices=('', 'enu', 'ned')),
        key_of(f'{name}.mounting', f'{name}.mounting', InputSettings,
               'how the sensor is turned in the body: roll, pitch, yaw from the axes of the body '
               '(forward, left, up) to those of the sensor, as rpy in a URDF', 'rad', -6.3, 6.3),
        _sensor_frame(name, 'mounting'),
    ]


def _sensor_frame(name: str, key: str) -> Key:
    """Return the key of the frame that stands for another key."""
    return key_of(f'{name}.sensor_frame', f'{name}.sensor_frame', InputSettings,
                  f'frame of the sensor: {key}, where it is not given, is looked up once in the '
                  'static transforms of tf2 (/tf_static), from base_frame; empty: as given')


def _run() -> list[Key]:
    return [
        key_of('dofs', 'dofs', Settings, 'degrees of freedom to identify', choices=DOFS),
        key_of('hardware_id', 'hardware_id', Settings,
               'what /diagnostics names the vehicle by; empty: the full name of the node'),
        key_of('frames', 'frames', Settings,
               'frames of the input messages: enu (z up, body flu) or ned (z down, body frd)',
               choices=('enu', 'ned')),
        key_of('base_frame', 'base_frame', Settings, 'frame_id of the outputs'),
        key_of('max_wait', 'max_wait', Settings,
               'a slow input is waited for until the newest event time is this much later; below '
               '0: 0.1 s, as much more as the latencies of the inputs differ, and up to 1 s where '
               'one keeps coming later', 's', -1.0, 60.0, live=True),
        key_of('max_gap', 'max_gap', Settings,
               'after a longer gap filter and observer restart from the measurement; 0: five '
               'usual intervals of the input, and at least 1 s', 's', 0.0, 3600.0, live=True),
        key_of('time_jump', 'time_jump', Settings,
               'stamps that go back by more are a jump (a restarted log), by less are dropped',
               's', 0.001, 3600.0),
        key_of('reset_on_time_jump', 'reset_on_time_jump', Settings,
               'whether the estimate starts afresh at a jump'),
        key_of('autostart', 'autostart', Settings,
               'whether the node configures and activates itself'),
        key_of('enable', 'enable', Settings,
               'whether the parameters are adapted, or frozen; as the service ~/enable',
               live=True),
        key_of('record.path', 'record_path', Settings,
               'MCAP file to record every consumed message in; empty: none'),
        key_of('record.max_size', 'record_max_size', Settings,
               'a record that is larger goes on in the next file; 0: never', 'bytes', 0.0),
        key_of('record.max_duration', 'record_max_duration', Settings,
               'a record that is longer goes on in the next file; 0: never', 's', 0.0, 1e7),
        key_of('checkpoint.path', 'checkpoint_path', Settings,
               'file of the saved state, read at the start; empty: none'),
        key_of('checkpoint.period', 'checkpoint_period', Settings,
               'time between two saves', 's', 0.1, 86400.0, live=True),
    ]


def _inputs() -> list[Key]:
    return [
        *_source('position', 'position', 'topic of the position fix in the world'),
        key_of('position.lever_arm', 'lever_arm', Settings,
               'position of the transponder in the body frame (forward, left, up)', 'm',
               -100.0, 100.0),
        _sensor_frame('position', 'lever_arm'),
        *_source('depth', 'depth', 'topic of the depth sensor; replaces position z for heave'),
        key_of('depth.scale', 'depth_scale', Settings, 'z [m, up] = scale * value + offset'),
        key_of('depth.offset', 'depth_offset', Settings, 'z [m, up] = scale * value + offset',
               'm'),
        *_source('attitude', 'attitude', 'topic of the attitude or of a scalar heading'),
        key_of('attitude.yaw_offset', 'yaw_offset', Settings,
               'added to the heading, about z up', 'rad', -6.3, 6.3),
        key_of('attitude.unit', 'heading_unit', Settings,
               'unit of a heading, or of roll, pitch and yaw', choices=('rad', 'deg')),
        key_of('attitude.heading', 'heading_frames', Settings,
               'sense of a heading, or of roll, pitch and yaw: enu, from x of the world to y; '
               'ned, from north clockwise, as a compass; empty: as frames',
               choices=('', 'enu', 'ned')),
        *_mounted('attitude'),
        *_source('angular_velocity', 'angular_velocity',
                 'topic of a gyro; replaces the attitude for roll, pitch and yaw'),
        *_mounted('angular_velocity'),
        *_source('velocity', 'velocity',
                 'topic of a body velocity (DVL); replaces the derivative of the position'),
        key_of('velocity.cutoff', 'cutoff', Settings,
               'cutoff of the low-pass on velocity and thrust alike', 'Hz', 0.001, 1000.0,
               live=True),
        key_of('velocity.max', 'max_speed', Settings, 'faster measurements are refused',
               'm/s or rad/s', 0.01, 1000.0, live=True),
        key_of('velocity.gate', 'gate', Settings,
               'measurements that miss their prediction by more are refused, if noise is alike on '
               'all axes; 0: none are',
               'std', 0.0, 1000.0, live=True),
        key_of('velocity.relative_to', 'relative_to', Settings,
               'what the velocity is relative to: ground (bottom lock) or water (water lock)',
               choices=('ground', 'water')),
        *_mounted('velocity'),
        *_source('reference', 'reference',
                 'topic of a body velocity to score against, never used to identify'),
    ]


def _thrusters() -> list[Key]:
    key = partial(in_group, 'thrusters', ThrusterSettings)
    return [
        Key('thrusters.topic', '', 'string', '', 'topic of all thrusters in one message'),
        *_source('thrusters', 'thrusters', 'topics of the thrusters, one each, in place of topic',
                 ThrusterSettings),
        key('names', "picks and orders a JointState's entries; none: its own order"),
        key('offset', 'subtracted from the command first, such as 1500 for PWM'),
        key('scale', 'then multiplies the command: 0.0025 makes -1 to 1 of PWM'),
        key('reverse', 'force of a negative command relative to that of the same positive one',
            low=0.0),
        key('deadband', 'commands up to this size, after offset and scale, count as 0', low=0.0),
        key('limit', 'commands beyond this size, after offset and scale, count as it; beyond '
            'twice this size they are refused; 0: none', low=0.0),
        key('model', 'force of a command i: k i, k i|i|, polynomial or table',
            choices=('linear', 'quadratic', 'polynomial', 'table')),
        key('gain', 'k, one per thruster; their number is the number of thrusters', 'N/command'),
        key('polynomial', 'coefficients from the constant term upwards, times k'),
        key('table_command', 'commands of the table, increasing'),
        key('table_force', 'forces of the table, times k', 'N'),
        key('delay', 'dead time from the command to the force', 's', 0.0, 10.0),
        key('time_constant', 'first-order lag of the force; 0: none', 's', 0.0, 10.0),
        key('hold', 'force between two commands: the previous one, or linear between both',
            choices=('previous', 'linear')),
        key('timeout', 'an older command is stale; 0: it holds for ever', 's', 0.0, 3600.0,
            live=True),
        key('allocation', 'six rows (surge to yaw) of one number per thruster: direction of the '
            'force, then position x direction', '- and m', -1e6, 1e6),
        *_source('thrusters.sign', 'sign',
                 'topic that gives the direction of currents that are never negative'),
    ]


def _identifier() -> list[Key]:
    key = partial(in_group, 'identifier', IdentifierSettings)
    return [
        key('method', 'aid (the adaptive identifier of the paper) or ekf (extended Kalman '
            'filter)', choices=tuple(METHODS)),
        key('integrator', 'how aid integrates its state, with raw gains',
            choices=('euler', 'heun', 'rk4')),
        key('adaptation_time', 'half of the time in which the estimate closes 63 % of its error',
            's', 0.01, 1e6, live=True),
        key('feedback_gain', 'a of eq. 7; 0: from adaptation_time', '1/s', -1e6, 0.0,
            live=True),
        key('adaptation_gains', 'diagonal of Gamma: 4 numbers (alpha, beta, gamma, delta), or 4 '
            'and one per coupling for every DOF; none: from adaptation_time', low=0.0, live=True),
        key_of('current.prior', 'current.prior', CurrentSettings,
               'standard deviation of the current of the water before anything is known of it; '
               '0: still water, as in a tank', 'm/s', 0.0, 10.0),
        key_of('current.change', 'current.change', CurrentSettings,
               'how fast the current changes: growth of its variance per second', 'm^2/s^3',
               0.0, 1.0),
    ]


def _dof(dof: str) -> list[Key]:
    """Return the keys of one degree of freedom: what is known beforehand, and the truth."""
    linear = dof in LINEAR_DOFS
    units = (('kg', 'N s^2/m^2', 'N s/m', 'N') if linear
             else ('kg m^2', 'N m s^2/rad^2', 'N m s/rad', 'N m'))
    force, speed = ('N', 'm/s') if linear else ('N m', 'rad/s')
    known, truth = f'dof.{dof}', f'simulation.dofs.{dof}'
    lows = (0.0, 0.0, 0.0, -LARGE)
    texts = ('effective mass, added mass included', 'quadratic drag', 'linear drag',
             'constant force towards negative; weight - buoyancy for heave')
    return [
        *(key_of(f'{dof}.initial.{name}', f'{known}.{name}', DofSettings,
                 f'initial guess of the {text}', unit, low)
          for name, text, unit, low in zip(PHYSICAL, texts, units, lows, strict=True)),
        key_of(f'{dof}.typical.force', f'{known}.typical_force', DofSettings,
               'usual force, for the scale of the gains; 0: from the initial values', force, 0.0),
        key_of(f'{dof}.typical.velocity', f'{known}.typical_velocity', DofSettings,
               'usual velocity, for the scale of the gains; 0: 0.5', speed, 0.0),
        key_of(f'{dof}.dry_mass', f'{known}.dry_mass', DofSettings,
               'mass in air (moment of inertia of an angular DOF); 0: unknown', units[0], 0.0),
        key_of(f'{dof}.terms', f'{known}.terms', DofSettings,
               'parameters that the model has; the others are 0', choices=PARAMETERS),
        key_of(f'{dof}.couplings', f'{known}.couplings', DofSettings,
               'further terms: of other DOFs, of the attitude, in reverse',
               choices=COUPLINGS[dof]),
        *(key_of(f'simulation.{dof}.{name}', f'{truth}.{name}', SimulatedDof,
                 f'truth of the simulation: {text}', unit, low)
          for name, text, unit, low in zip(PHYSICAL, texts, units, lows, strict=True)),
        key_of(f'simulation.{dof}.forces', f'{truth}.forces', SimulatedDof,
               'amplitudes of the sinusoids of thrust', force),
        key_of(f'simulation.{dof}.frequencies', f'{truth}.frequencies', SimulatedDof,
               'their frequencies, as many', 'Hz', 0.0, 100.0),
        key_of(f'simulation.{dof}.reverse_drag', f'{truth}.reverse_drag', SimulatedDof,
               'quadratic drag of the simulation when it moves backwards, relative to forwards',
               low=0.0),
        key_of(f'simulation.{dof}.disturbance', f'{truth}.disturbance', SimulatedDof,
               'rms of an unknown force in the simulation', force, 0.0),
    ]


def _simulation() -> list[Key]:
    key = partial(in_group, 'simulation', SimulationSettings)
    units = {'position': 'm', 'depth': 'm', 'attitude': 'rad', 'angular_velocity': 'rad/s',
             'velocity': 'm/s', 'thruster': 'command'}
    return [
        *(key(f'{sensor}_rate', f'messages of the simulated {sensor}', 'Hz', 0.01, 10000.0)
          for sensor in units),
        *(key(f'{sensor}_noise', f'standard deviation of the simulated {sensor}', unit, 0.0)
          for sensor, unit in units.items()),
        key('publish_w', 'estimates carry the Lyapunov function W against this truth'),
        key('coriolis', 'the simulated vehicle has the Coriolis forces of its masses'),
        key('mass_matrix', 'of the simulated vehicle, 6 rows surge to yaw; left out: its masses '
            'on the diagonal', 'kg'),
        key('current', 'velocity of the simulated water, x and y in the ENU world', 'm/s', -10.0,
            10.0),
        key('current_turn', 'time in which the current of the simulation turns once, from x to y; '
            '0: it does not', 's', 0.0, 1e6),
        key('current_tide', 'period of a current of the simulation that comes and goes as a '
            'cosine; 0: it is steady', 's', 0.0, 1e6),
        key('righting', 'righting moments of the simulated roll and pitch at 90 degrees', 'N m',
            0.0),
    ]


KEYS = (*_run(), *_inputs(), *_thrusters(), *_identifier(),
        *(key for dof in DOFS for key in _dof(dof)), *_simulation())
