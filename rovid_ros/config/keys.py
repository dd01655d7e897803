"""All parameters (``KEYS``): name, type, default, unit, range and meaning of each."""

from __future__ import annotations

from dataclasses import dataclass, fields, MISSING
from functools import partial
from typing import Any

from rovid_core.identify import METHODS
from rovid_core.model.dofs import COUPLINGS, DOFS, LINEAR_DOFS, PARAMETERS, PHYSICAL
from rovid_core.settings.inputs import LONGEST_LAG
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    InputSettings,
    MOST_WAIT,
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
    def has_bounds(self) -> bool:
        """Tell whether its numbers have a range."""
        return (self.low, self.high) != (-LARGE, LARGE)

    @property
    def takes(self) -> str:
        """Return what the key takes, to end a sentence with."""
        unit = f' [{self.unit}]' if self.unit else ''
        bounds = f' from {self.low:g} to {self.high:g}' if self.has_bounds else ''
        count = f'{self.size} ' if self.size else ''
        return {
            'double': f'a number{bounds}{unit}',
            'bool': 'true or false',
            'string': 'one of ' + ', '.join(repr(c) for c in self.choices) if self.choices
                      else 'text',
            'double[]': f'a list of {count}numbers{bounds}{unit}',
            'string[]': 'a list of ' + (', '.join(self.choices) if self.choices else 'texts'),
        }[self.type]


def key_of(section: str, place: str, owner: type, name: str, description: str, unit: str = '',
           low: float = -LARGE, high: float = LARGE, choices: tuple[str, ...] = (),
           live: bool = False, setting: str = '') -> Key:
    """
    Return a key of a section of the file, with the type and default of the owner's field.

    ``section`` and ``place``, that of the settings, end with a dot where they are not empty.
    ``setting`` is the name of the field where it is not that of the key.
    """
    setting = setting or name
    field = {f.name: f for f in fields(owner)}[setting]
    kind, size, default = _TYPES[str(field.type)]
    if field.default is not MISSING:
        default = field.default
    return Key(section + name, place + setting, kind, default, description, unit, low, high,
               choices, size, live)


def _source(name: str, setting: str, what: str, owner: type = InputSettings) -> list[Key]:
    """Return the keys that say where an input comes from."""
    key = partial(key_of, f'{name}.', f'{setting}.', owner)
    topic = 'topics' if owner is ThrusterSettings else 'topic'
    timeout = [] if owner is ThrusterSettings else [key(
        'timeout', 'silent for longer it starts anew, and what needs it waits no more; 0: max_gap',
        's', 0.0, 3600.0)]
    return [
        key(topic, what),
        key('type', 'message type, package/msg/Type; a log knows its own'),
        key('field', 'field path in the message, dotted, with [i] for an index, or several with '
            'commas; empty: all of it'),
        key('stamp', 'time of the data: header stamp or receive time; empty: header where there '
            'is one', choices=('', 'header', 'receive')),
        key('latency', 'time between the measurement and its stamp, subtracted', 's', -10.0, 10.0),
        key('qos', 'quality of service of the live subscription: sensor_data hears every '
            'publisher, transient_local also what was published before',
            choices=('sensor_data', 'reliable', 'transient_local')),
        *timeout,
    ]


def _mounted(name: str) -> list[Key]:
    """Return the keys that say how a sensor of the body is turned in it."""
    key = partial(key_of, f'{name}.', f'{name}.', InputSettings)
    return [
        key('frames', 'frames of these messages, such as ned for a DVL with z down and y to the '
            'right; empty: as frames', choices=('', 'enu', 'ned')),
        key('mounting', 'how the sensor is turned in the body: roll, pitch, yaw from the axes of '
            'the body (forward, left, up) to those of the sensor, as rpy in a URDF', 'rad', -6.3,
            6.3),
        _sensor_frame(name, 'mounting and lever_arm' if name == 'velocity' else 'mounting'),
    ]


def _lever_arm(name: str, of: str) -> Key:
    """Return the key that says where a sensor is in the body."""
    return key_of(f'{name}.', f'{name}.', InputSettings, 'lever_arm', 'position in the body frame '
                  f'(forward, left, up) of the {of}', 'm', -100.0, 100.0)


def _sensor_frame(name: str, key: str) -> Key:
    """Return the key of the frame that stands for another key."""
    return key_of(f'{name}.', f'{name}.', InputSettings, 'sensor_frame',
                  f'frame of the sensor: {key}, where it is not given, is looked up once in the '
                  'static transforms of tf2 (/tf_static), from base_frame; empty: as given')


def _run() -> list[Key]:
    key = partial(key_of, '', '', Settings)
    return [
        key('dofs', 'degrees of freedom to identify', choices=DOFS),
        key('hardware_id', 'what /diagnostics names the vehicle by; empty: the full name of the '
            'node'),
        key('frames', 'frames of the input messages: enu (z up, body flu) or ned (z down, body '
            'frd)', choices=('enu', 'ned')),
        key('base_frame', 'frame_id of the outputs'),
        key('max_wait', 'a slow input is waited for until the newest event time is this much '
            'later; below 0: 0.1 s, as much more as the latencies of the inputs differ, and up to '
            '1 s where one keeps coming later', 's', -1.0, MOST_WAIT, live=True),
        key('max_gap', 'after a longer gap filter and observer restart from the measurement; 0: '
            'five usual intervals of the input, and at least 1 s', 's', 0.0, 3600.0, live=True),
        key('time_jump', 'stamps that go back by more are a jump (a restarted log), by less are '
            'dropped', 's', 0.001, 3600.0),
        key('reset_on_time_jump', 'whether the estimate starts afresh at a jump'),
        key('autostart', 'whether the node configures and activates itself'),
        key('enable', 'whether the parameters are adapted, or frozen; as the service ~/enable',
            live=True),
        key('record.path', 'MCAP file to record every consumed message in; empty: none',
            setting='record_path'),
        key('record.max_size', 'a record that is larger goes on in the next file; 0: never',
            'bytes', 0.0, setting='record_max_size'),
        key('record.max_duration', 'a record that is longer goes on in the next file; 0: never',
            's', 0.0, 1e7, setting='record_max_duration'),
        key('checkpoint.path', 'file of the saved state, read at the start; empty: none',
            setting='checkpoint_path'),
        key('checkpoint.period', 'time between two saves', 's', 0.1, 86400.0, live=True,
            setting='checkpoint_period'),
    ]


def _inputs() -> list[Key]:
    key = partial(key_of, '', '', Settings)
    return [
        *_source('position', 'position', 'topic of the position fix in the world'),
        _lever_arm('position', 'transponder'),
        _sensor_frame('position', 'lever_arm'),
        *_source('depth', 'depth', 'topic of the depth sensor; replaces position z for heave'),
        key('depth.scale', 'z [m, up] = scale * value + offset', setting='depth_scale'),
        key('depth.offset', 'z [m, up] = scale * value + offset', 'm', setting='depth_offset'),
        *_source('attitude', 'attitude', 'topic of the attitude or of a scalar heading'),
        key('attitude.yaw_offset', 'added to the heading, about z up', 'rad', -6.3, 6.3,
            setting='yaw_offset'),
        key('attitude.unit', 'unit of a heading, or of roll, pitch and yaw',
            choices=('rad', 'deg'), setting='heading_unit'),
        key('attitude.heading', 'sense of a heading, or of roll, pitch and yaw: enu, from x of '
            'the world to y; ned, from north clockwise, as a compass; empty: as frames',
            choices=('', 'enu', 'ned'), setting='heading_frames'),
        *_mounted('attitude'),
        *_source('angular_velocity', 'angular_velocity',
                 'topic of a gyro; replaces the attitude for roll, pitch and yaw'),
        *_mounted('angular_velocity'),
        *_source('velocity', 'velocity',
                 'topic of a body velocity (DVL); replaces the derivative of the position'),
        key('velocity.cutoff', 'cutoff of the low-pass on velocity and thrust alike', 'Hz', 0.001,
            1000.0, live=True, setting='cutoff'),
        key('velocity.max', 'faster measurements are refused', 'm/s or rad/s', 0.01, 1000.0,
            live=True, setting='max_speed'),
        key('velocity.gate', 'measurements that miss their prediction by more are refused, if '
            'noise is alike on all axes; 0: none are', 'std', 0.0, 1000.0, live=True,
            setting='gate'),
        key('velocity.relative_to', 'what the velocity is relative to: ground (bottom lock) or '
            'water (water lock)', choices=('ground', 'water'), setting='relative_to'),
        *_mounted('velocity'),
        _lever_arm('velocity', 'DVL; takes an angular_velocity.topic'),
        *_source('reference', 'reference',
                 'topic of a body velocity to score against, never used to identify'),
    ]


def _thrusters() -> list[Key]:
    key = partial(key_of, 'thrusters.', 'thrusters.', ThrusterSettings)
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
        key('dead_zone', 'every command, after offset and scale, counts as so much smaller',
            low=0.0),
        key('limit', 'commands beyond this size, after offset and scale, count as it; beyond '
            'twice this size they are refused; 0: none', low=0.0),
        key('model', 'force of a command i: k i, k i|i|, polynomial or table',
            choices=('linear', 'quadratic', 'polynomial', 'table')),
        key('gain', 'k, one per thruster; below 0: the motor turns the other way', 'N/command'),
        key('newtons', 'false: nobody knows the newtons of a command, so that masses, drags and '
            'biases are relative to a command of 1, in cmd instead of kg and N'),
        key('polynomial', 'coefficients from the constant term upwards, times k'),
        key('table_command', 'commands of the table, increasing'),
        key('table_force', 'forces of the table, times k', 'N'),
        key('delay', 'dead time from the command to the force', 's', 0.0, 10.0),
        key('time_constant', 'first-order lag of the force; 0: none', 's', 0.0, LONGEST_LAG),
        key('lag_of_turns', "true: that is the lag of the propellers' turns, whose force goes "
            'with their square'),
        key('lag_at', 'above 0: a torque or current turns the propellers, so that they lag the '
            'more the less it is, by time_constant where one thruster gives this force', 'N',
            low=0.0),
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
    key = partial(key_of, 'identifier.', 'identifier.', IdentifierSettings)
    current = partial(key_of, 'current.', 'current.', CurrentSettings)
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
        current('prior', 'standard deviation of the current of the water before anything is known '
                'of it; 0: still water, as in a tank', 'm/s', 0.0, 10.0),
        current('change', 'how fast the current changes: growth of its variance per second',
                'm^2/s^3', 0.0, 1.0),
    ]


def _dof(dof: str) -> list[Key]:
    """Return the keys of one degree of freedom: what is known beforehand, and the truth."""
    linear = dof in LINEAR_DOFS
    units = (('kg', 'N s^2/m^2', 'N s/m', 'N') if linear
             else ('kg m^2', 'N m s^2/rad^2', 'N m s/rad', 'N m'))
    force, speed = ('N', 'm/s') if linear else ('N m', 'rad/s')
    known = partial(key_of, f'{dof}.', f'dof.{dof}.', DofSettings)
    truth = partial(key_of, f'simulation.{dof}.', f'simulation.dofs.{dof}.', SimulatedDof)
    lows = (0.0, 0.0, 0.0, -LARGE)
    texts = ('effective mass, added mass included', 'quadratic drag', 'linear drag',
             'constant force towards negative; weight - buoyancy for heave')
    return [
        *(known(f'initial.{name}', f'initial guess of the {text}', unit, low, setting=name)
          for name, text, unit, low in zip(PHYSICAL, texts, units, lows, strict=True)),
        known('typical.force', 'usual force, for the scale of the gains; 0: from the initial '
              'values', force, 0.0, setting='typical_force'),
        known('typical.velocity', 'usual velocity, for the scale of the gains; 0: 0.5', speed, 0.0,
              setting='typical_velocity'),
        known('dry_mass', 'mass in air (moment of inertia of an angular DOF); 0: unknown',
              units[0], 0.0),
        known('terms', 'parameters that the model has; the others are 0', choices=PARAMETERS),
        known('couplings', 'further terms: of other DOFs, of the attitude, in reverse',
              choices=COUPLINGS[dof]),
        *(truth(name, f'truth of the simulation: {text}', unit, low)
          for name, text, unit, low in zip(PHYSICAL, texts, units, lows, strict=True)),
        truth('forces', 'amplitudes of the sinusoids of thrust', force),
        truth('frequencies', 'their frequencies, as many', 'Hz', 0.0, 100.0),
        truth('reverse_drag', 'quadratic drag of the simulation when it moves backwards, relative '
              'to forwards', low=0.0),
        truth('disturbance', 'rms of an unknown force in the simulation', force, 0.0),
    ]


def _simulation() -> list[Key]:
    key = partial(key_of, 'simulation.', 'simulation.', SimulationSettings)
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
BY_NAME = {key.name: key for key in KEYS}
