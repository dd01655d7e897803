"""The faults: what each does to the messages, and what the node has to say about it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan

from test.support.fault_edits import (
    ALL,
    changed,
    Edit,
    late,
    lost,
    Recording,
    SECOND,
    Span,
    stamped,
    stuck,
    valued,
)
from test.support.fault_values import (
    as_degrees,
    damaged,
    drift,
    fixed_at,
    garbage,
    half_turned,
    moved,
    multipath,
    other,
    repeated,
    times,
    until_next,
    upside_down,
    without_name,
)

HOUR = 3600 * SECOND
FAR = 1e300


@dataclass(frozen=True)
class Fault:
    """
    A fault.

    Attributes
    ----------
    name, what : str
        What it is called, and what is done.
    input : str
        That it befalls, '' for all; a vehicle without it is left out.
    duration : float
        How long it is on [s].
    edit : callable
        Does it.
    says : str
        Pattern of what the node has to say: ``input.reason`` of what it refuses, a warning,
        or a status. '': the fault is harmless, and nothing has to be said.
    early : bool
        Whether it is on from the first message.
    settled : bool
        Whether the messages alone decide what comes of it, and not when or in which order
        they arrive.
    named : bool
        Whether the entries of the message have names.

    """

    name: str
    what: str
    input: str
    duration: float
    edit: Edit
    says: str = ''
    early: bool = False
    settled: bool = True
    named: bool = False

    def span(self, recording: Recording) -> Span:
        """Return when it is on in a recording."""
        on = recording.begin + (0 if self.early else round(recording.on * SECOND))
        last = recording.end + 1
        return Span(on, last if self.duration == inf
                    else min(last, on + round(self.duration * SECOND)))

    def fits(self, recording: Recording) -> bool:
        """Tell whether a recording can have it."""
        return recording.has(self.input) and (
            not self.named or bool(recording.settings.thrusters.names))


SILENCE = [
    Fault(f'{input or "everything"} silent {duration:g} s', 'no message', input, duration,
          lost(input), says)
    for input, says in (
        ('position', r'position\.gap'), ('depth', r'depth\.gap'),
        ('attitude', r'attitude\.gap|no_attitude'), ('thrusters', r'stale_thrust'),
        (ALL, r'\.gap'))
    for duration in (1.2, 10.0, 60.0)]
SILENCE += [
    Fault('half of all lost', 'each message is lost with probability 1/2', ALL, 60.0,
          lost(ALL, lambda moment: bool(moment.random.random() < 0.5))),
    Fault('1 fix of 3', 'two of three fixes are lost', 'position', 60.0,
          lost('position', lambda moment: moment.count % 3 == 0)),
]

OUTLIERS = [
    Fault('outliers 1 %', '1 % of the fixes are off by 1 m', 'position', 60.0,
          valued('position', moved(1.0, 1.0, 0.0, share=0.01)), 'too_fast|outlier'),
    Fault('outliers 5 %', '5 % of the fixes are off by 1 m', 'position', 60.0,
          valued('position', moved(1.0, 1.0, 0.0, share=0.05)), 'too_fast|outlier'),
    Fault('outliers 30 cm', '5 % of the fixes are off by 0.3 m', 'position', 60.0,
          valued('position', moved(0.3, 0.3, 0.0, share=0.05)), 'too_fast|outlier'),
    Fault('multipath, agreeing', '3 to 6 fixes in a row off by the same up to 4 m, each 40 fixes',
          'position', 60.0, valued('position', multipath(True)), 'too_fast|shifted|outlier'),
    Fault('multipath, scattered', '3 to 6 fixes in a row off by up to 4 m, each 40 fixes',
          'position', 60.0, valued('position', multipath(False)), 'too_fast|shifted|outlier'),
    Fault('depth outliers 5 %', '5 % of the depths are those of 1 m away', 'depth', 60.0,
          valued('depth', moved(9806.65, share=0.05)), 'too_fast|outlier'),
    Fault('attitude flips', '5 % of the attitudes are turned by half a turn', 'attitude', 60.0,
          valued('attitude', half_turned), 'too_fast|outlier'),
    Fault('thruster spikes', '2 % of the commands are 20 times as large', 'thrusters', 60.0,
          valued('thrusters', times(20.0, share=0.02)), 'thrust|outlier|model'),
]

LASTING = [
    Fault('fix jumps by 2 m', 'all fixes from then on', 'position', inf,
          valued('position', moved(2.0, -2.0, 0.0)), 'shifted|too_fast'),
    Fault('fix drifts', 'by 2 m in a minute, which stay', 'position', inf,
          valued('position', drift), 'model|drift|changed'),
    Fault('fix stuck', 'the same value with new stamps', 'position', 20.0,
          stuck('position'), 'stuck'),
    Fault('depth stuck', 'the same value with new stamps', 'depth', 20.0,
          stuck('depth'), 'stuck'),
    Fault('attitude stuck', 'the same value with new stamps', 'attitude', 20.0,
          stuck('attitude'), 'stuck'),
    Fault('a current reads 0', 'of the first thruster, which works', 'thrusters', 20.0,
          valued('thrusters', lambda u, moment: [0.0, *u[1:]]), 'model|changed'),
    Fault('a thruster reads the other way', 'its sign is wrong', 'thrusters', 20.0,
          valued('thrusters', lambda u, moment: [-u[0], *u[1:]]), 'model|changed'),
]

NUMBERS = [
    *(Fault(f'{input} {number:g}', f'every value is {number:g}', input, 10.0,
            valued(input, fixed_at(number)), rf'{input}\.non_finite')
      for input in ('position', 'depth', 'attitude', 'thrusters') for number in (nan, inf)),
    Fault('position 1e300', 'every value is 1e300', 'position', 10.0,
          valued('position', fixed_at(FAR)), r'position\.'),
    Fault('thrusters 1e300', 'every value is 1e300', 'thrusters', 10.0,
          valued('thrusters', fixed_at(FAR)), r'force_out_of_range|not_a_command'),
    Fault('quaternion of zeros', 'before the first solution', 'attitude', 10.0,
          valued('attitude', fixed_at(0.0)), 'not_a_rotation'),
    Fault('quaternion 3 times too long', 'not at unit length', 'attitude', 20.0,
          valued('attitude', times(3.0))),
    Fault('quaternion -q', 'every second one is the negative', 'attitude', 20.0,
          valued('attitude', lambda q, m: [-x for x in q] if m.count % 2 else q)),
    Fault('a command short', 'one thruster is missing from the message', 'thrusters', 10.0,
          valued('thrusters', lambda u, moment: u[:-1]), 'wrong_length'),
    Fault('no commands', 'the arrays are empty', 'thrusters', 10.0,
          valued('thrusters', lambda u, moment: []), 'wrong_length'),
    Fault('100,000 commands', 'the array is huge', 'thrusters', 2.0,
          valued('thrusters', lambda u, moment: [1.0] * 100_000), 'wrong_length'),
    Fault('a name missing', 'one thruster has left the message, name and all', 'thrusters', 10.0,
          changed('thrusters', without_name), 'missing_name', named=True),
    Fault('messages cut short', 'half of the bytes are missing', 'position', 10.0,
          damaged(lambda cdr, moment: cdr[:len(cdr) // 2]), 'undecodable|decoded'),
    Fault('random bytes', 'of the length of the message', 'position', 10.0,
          damaged(garbage), r'position\.|decoded'),
]

UNITS = [
    Fault('position in mm', '1000 times too large', 'position', 20.0,
          valued('position', times(1000.0)), 'takes metres'),
    Fault('heading in degrees', 'taken for radians', 'attitude', 20.0,
          valued('attitude', as_degrees), 'degree|unit'),
    Fault('depth upside down', 'its sign is wrong', 'depth', 20.0,
          upside_down, r'depth\.|sign|model|changed'),
    Fault('x and y swapped', 'north-east for east-north', 'position', 20.0,
          valued('position', lambda p, moment: [p[1], p[0], p[2]]), 'model|changed|shifted'),
]

TIMES = [
    Fault('everything twice', 'every message comes twice', ALL, 60.0,
          changed(ALL, lambda message, moment: [message, message]), 'duplicate'),
    Fault('out of order by 50 ms', 'every message is late by up to 50 ms', ALL, 60.0,
          late(ALL, lambda message, moment: moment.random.uniform(0.0, 0.05))),
    Fault('out of order by 2 s', 'every tenth message comes 2 s late', ALL, 60.0,
          late(ALL, lambda message, moment: 0.0 if moment.count % 10 else 2.0),
          'late|backward', settled=False),
    Fault('position in bursts', 'held for 3 s, then all at once', 'position', 30.0,
          late('position', until_next(3.0)), 'late'),
    Fault('everything in bursts', 'held for 3 s, then all at once', ALL, 30.0,
          late(ALL, until_next(3.0))),
    *(Fault(f'position {name}', f'its stamps are {what}', 'position', 20.0,
            stamped('position', lambda stamp, moment, by=by: stamp + by), says, settled=False)
      for name, what, by, says in (
          ('0.5 s ahead', '0.5 s ahead', SECOND // 2, 'model|late|ahead|too_fast|backward'),
          ('10 s ahead', '10 s ahead', 10 * SECOND, 'future|ahead|backward'),
          ('1 h ahead', '1 h ahead', HOUR, 'future|ahead'),
          ('10 s behind', '10 s behind', -10 * SECOND, 'backward|late'))),
    Fault('position since 1970', "its publisher's clock is not set for the first 10 s",
          'position', 10.0, stamped('position', lambda t, m: round((1 + m.since) * SECOND)),
          'backward|late|future|ahead', early=True, settled=False),
    Fault('everything since 1970', 'no clock is set for the first 10 s', ALL, 10.0,
          stamped(ALL, lambda t, m: round((1 + m.since) * SECOND)), 'future|gap', early=True,
          settled=False),
    Fault('clocks forward 1 h', 'all stamps from then on', ALL, inf,
          stamped(ALL, lambda t, m: t + HOUR), 'gap', settled=False),
    Fault('clocks back 1 h', 'all stamps from then on', ALL, inf,
          stamped(ALL, lambda t, m: t - HOUR), 'discarded|jump', settled=False),
    Fault('clocks forward 1 h and back', 'for 20 s', ALL, 20.0,
          stamped(ALL, lambda t, m: t + HOUR), 'gap|discarded|jump', settled=False),
    Fault('no stamps', "the position's stamps are zero", 'position', 10.0,
          stamped('position', lambda t, m: 0), 'zero_stamp', settled=False),
    Fault('stamps jitter', 'by 20 ms, one standard deviation', 'position', 60.0,
          stamped('position', lambda t, m: t + round(m.random.normal(0.0, 0.02) * SECOND))),
]

OTHERS = [
    Fault('a second vehicle', 'its fixes, 5 m away, come between ours', 'position', 20.0,
          other('position', lambda p: [p[0] + 5.0, *p[1:]], 0.02), 'too_fast|shifted|outlier'),
    Fault('a second pilot', 'commands of 0 come between ours', 'thrusters', 20.0,
          other('thrusters', lambda u: [0.0] * len(u), 0.01), 'model|changed|programs'),
    Fault('fixes 5 times as often', 'each is repeated with new stamps', 'position', 60.0,
          repeated('position', 5, 0.02), 'stuck|repeat'),
    Fault('commands 5 times as often', 'each is repeated with new stamps', 'thrusters', 60.0,
          repeated('thrusters', 5, 0.01)),
]

UNDISTURBED = 'undisturbed'
NOTHING = [Fault(UNDISTURBED, 'nothing', ALL, 0.0, lost(ALL))]

FAULTS: dict[str, list[Fault]] = {
    'Nothing': NOTHING, 'Silence': SILENCE, 'Outliers': OUTLIERS,
    'Wrong for a while': LASTING, 'Not a value': NUMBERS, 'Units and frames': UNITS,
    'Order and time': TIMES, 'Somebody else': OTHERS}
BY_NAME = {fault.name: fault for faults in FAULTS.values() for fault in faults}
