"""A discovery as a parameter file, with comments that say what is a guess."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from rovid_core.model.dofs import ANGULAR_DOFS, DOFS
from rovid_ros.config.parameter_file import scalar
from rovid_ros.discovery.decisions import Discovery, Known
from rovid_ros.discovery.signals import Signal
from rovid_ros.discovery.thrusters import Thrusters

_COMMENT = 35  # column where comments begin
_WIDTH = 96
_CUTOFF = 0.6  # [Hz] the default of velocity.cutoff
_FASTEST = 0.36  # of the sample rate: above 0.4 a cutoff is lowered, and the rate varies a little


def configuration(made: Discovery, source: str) -> str:
    """Return the text of the parameter file; ``source`` is what the log is called."""
    lines = [
        f'# Made by rovid init from {source}.', '#',
        *_wrapped('Guessed, so look at it:', made.guesses),
        *_wrapped('What no log can tell, to be put in by hand:', made.unknown),
        '# All keys are explained in jhurov.yaml.', '',
        '/**:', '  ros__parameters:',
        _line(4, f'dofs: [{", ".join(made.dofs)}]', 'what is driven and measured in this log'),
        _line(4, f'frames: {made.frames}', _FRAMES[made.frames])]
    for name in ('position', 'depth', 'attitude', 'angular_velocity', 'velocity'):
        if name in made.inputs:
            lines += ['', *_input(made, name)]
    if 'velocity' not in made.inputs:
        lines += ['', '    velocity:', *_velocity(made)]
    lines += ['', *_thrusters(made.thrusters, made.inputs['thrusters'].keys),
              *_others(made, 'thrusters'), '',
              '    identifier:', '      method: ekf', '',
              '    # Initial values: a rough fit of this log. Units are those of the command, and',
              '    # newtons only where it is in newtons.']
    for dof, known in made.dofs.items():
        lines += _dof(dof, known)
    return '\n'.join(lines) + '\n'


_FRAMES = {'enu': 'of the messages: world z up, body forward-left-up',
           'ned': 'of the messages: world north-east-down, body forward-right-down'}


def _line(indent: int, text: str, comment: str = '') -> str:
    text = ' ' * indent + text
    return f'{text:<{_COMMENT - 1}} # {comment}' if comment else text


def _wrapped(title: str, points: Sequence[str]) -> list[str]:
    lines = [f'# {title}'] if points else []
    for point in points:
        words, line = point.split(), '# *'
        for word in words:
            if len(line) + len(word) >= _WIDTH:
                lines.append(line)
                line = '#  '
            line += f' {word}'
        lines.append(line)
    return [*lines, '#'] if points else []


def _up(value: float) -> float:
    """Return a number rounded up to one digit behind the point."""
    return math.ceil(10.0 * value - 1e-9) / 10.0


def _source(signal: Signal) -> list[str]:
    topics = [f'      topic: {_text(signal.topic)}']
    if signal.topics:
        topics = ['      topics:', *[f'        - {_text(topic)}' for topic in signal.topics]]
    return [*topics, f'      type: {signal.type}',
            f'      field: {_text(signal.path)}']


def _text(value: str) -> str:
    """Return a text as YAML; in quotes if it would be read as something else."""
    return value if value and scalar(value) == value else f"'{value}'"


def _input(made: Discovery, name: str) -> list[str]:
    candidate = made.inputs[name]
    signal = candidate.signal
    lines = [_line(4, f'{name}:', f'{signal.rate:.3g} Hz'), *_source(signal)]
    comments = {'scale': '[m] z up = scale * value + offset'}
    if name == 'position' and made.open_latency:
        told = f'{made.open_latency} explains this log alike: measure it'
        comments['latency'] = f'[s] a guess, {told}'
        if 'latency' not in candidate.keys:
            lines.append(f'      # latency: {told}')
    for key, value in candidate.keys.items():
        comment = comments.get(key, '')
        text = f'{float(value):.8g}' if isinstance(value, float) else f'{value}'
        lines.append(_line(6, f'{key}: {_number(text)}', comment))
    if name == 'attitude' and made.yaw_offset:
        lines.append(_line(6, f'yaw_offset: {made.yaw_offset}', '[rad] see above'))
    if name == 'velocity':
        lines += _velocity(made)
    return [*lines, *_others(made, name)]


def _number(text: str) -> str:
    """Return a number as YAML takes it for a double."""
    return f'{text}.0' if text.lstrip('-').isdigit() else text


def _velocity(made: Discovery) -> list[str]:
    sampled = [made.inputs[name].signal.rate for name in
               ('position', 'depth', 'velocity', 'angular_velocity', 'attitude')
               if name in made.inputs]
    cutoff = min(_CUTOFF, _FASTEST * min(sampled))
    return [_line(6, f'cutoff: {cutoff:.3g}', '[Hz]'),
            _line(6, f'max: {_up(max(3.0, 3.0 * made.fastest))}',
                  f'[m/s and rad/s] it seldom exceeds {made.fastest:.2g} here')]


def _others(made: Discovery, name: str) -> list[str]:
    """Return a comment on what else the input could be."""
    places = [one.signal.place for one in made.others.get(name, ())][:4]
    return [f'      # or: {"; ".join(places)}'] if places else []


def _thrusters(made: Thrusters, keys: Mapping[str, Any]) -> list[str]:
    signal, chain = made.signal, made.chain
    lines = [_line(4, 'thrusters:', f'{signal.rate:.3g} Hz'), *_source(signal)]
    if 'stamp' in keys:
        lines.append(f'      stamp: {keys["stamp"]}')
    if chain.names:
        lines.append(f'      names: [{", ".join(map(_text, chain.names))}]')
    timeout = max(0.3, 3.0 / max(signal.rate, 1e-3))
    if made.how == 'wrench':
        lines.append('      # the force on the body already: gain and allocation are not needed')
    else:
        lines += _chain(made)
    if made.latency:
        lines.append(_line(6, f'latency: {made.latency}',
                           '[s] commands are samples of faster ones: half of their interval'))
    lines += [_line(6, f'delay: {made.delay}', '[s] roughly; rovid tune finds it better'),
              _line(6, f'timeout: {_up(max(timeout, 1.5 * min(signal.longest_gap, 1.0)))}',
                    '[s] an older command counts no more')]
    return lines


def _chain(made: Thrusters) -> list[str]:
    chain = made.chain
    lines = []
    if chain.model == 'polynomial':
        lines += [
            _line(6, f'offset: {float(chain.offset)}', 'pulses [us] that push nothing, and'),
            _line(6, f'scale: {chain.scale}', '  1100 to 1900 become -1 to 1'),
            f'      limit: {chain.limit}', f'      deadband: {chain.deadband}',
            _line(6, 'model: polynomial', 'a T200 near 12 V; others need their own curve'),
            f'      polynomial: [{", ".join(map(repr, chain.polynomial))}]']
    elif chain.model == 'quadratic':
        lines.append(_line(6, 'model: quadratic', "a propeller's speed; its force is u|u|"))
    lines.append(_line(6, f'gain: [{", ".join(map(repr, chain.gain))}]',
                       'N per command; -1 where a motor is reversed' if made.how == 'frame' else
                       'newtons per command are not known:'))
    if made.how != 'frame':
        lines.append(_line(6, 'newtons: false', '  masses and drags are per unit of the command'))
    lines.append('      allocation:')
    rows = [made.rows.get(dof, (0.0,) * len(chain.gain)) for dof in DOFS]
    texts = [', '.join(f'{value:7.4g}' if value % 1.0 else f'{value:7.1f}' for value in row)
             for row in rows]
    for k, (dof, text) in enumerate(zip(DOFS, texts, strict=True)):
        last = k == len(DOFS) - 1
        lines.append(f'        {"[" if k == 0 else " "}{text}{"]" if last else ","}   # {dof}')
    return lines


def _dof(dof: str, known: Known) -> list[str]:
    def text(value: float) -> str:
        return _number(f'{float(f"{value:.3g}"):.10g}')

    unit = ('rad/s', 'moment') if dof in ANGULAR_DOFS else ('m/s', 'force')
    said = {1: f'explains {100.0 * known.explained:.0f} % of the changes of its velocity',
            0: 'the log hardly says', -1: 'it goes against its command'}[known.sign]
    return [
        _line(4, f'{dof}:', said),
        f'      initial: {{mass: {text(known.mass)}, quadratic_drag: '
        f'{text(known.quadratic_drag)}, linear_drag: {text(known.linear_drag)}, bias: 0.0}}',
        f'      typical: {{force: {text(known.force)}, velocity: {text(known.velocity)}}}'
        f'   # {unit[1]}, {unit[0]}',
        *([f'      couplings: [{", ".join(known.couplings)}]'] if known.couplings else []),
        *([f'      dry_mass: {text(known.dry_mass)}'] if known.dry_mass else [])]
