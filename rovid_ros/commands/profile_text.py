"""Thrust profiles as text: one grammar for the command line and for what a log says."""

from __future__ import annotations

from collections.abc import Callable
import difflib
import re

from rovid_core.model.dofs import DOFS
from rovid_core.simulation.profiles import (
    Multisine,
    Profile,
    ProfileError,
    Sinusoid,
    Steps,
    Waveform,
)

GRAMMAR = """\
profiles: DOF=WAVES[,DOF=WAVES ...], forces in N (N m for roll, pitch, yaw)
  surge=120@0.083                sinusoid: AMPLITUDE@FREQUENCY [Hz]
  surge=120@0.083+60@0.04        waves that add up
  surge=100@0.05,yaw=20@0.08     two degrees of freedom
  surge=multisine:120@0.02-0.2x12    12 frequencies, evenly from 0.02 to 0.2 Hz,
                                 whose sum stays within 120 N (Schroeder's phases)
  surge=steps:100@20             100 and -100 in turn, each for 20 s
  surge=steps:100/50/0/-150@20   these in turn, over and over, each for 20 s
  surge=0                        no thrust
A degree of freedom that is not named gets the sinusoids of the parameter file
(simulation.DOF.forces and frequencies)."""

_NUMBER = r'([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)'
_POSITIVE = r'((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)'
_SINUSOID = re.compile(rf'{_NUMBER}@{_POSITIVE}')
_MULTISINE = re.compile(rf'{_NUMBER}@{_POSITIVE}-{_POSITIVE}x(\d{{1,9}})')
_STEPS = re.compile(rf'({_NUMBER}(?:/{_NUMBER})*)@{_POSITIVE}')
# a plus that adds a wave follows a wave; others are signs of numbers and exponents
_PLUS = re.compile(r'(?<=[^eE:/@\s])\s*\+')


def parse_profile(text: str) -> Profile:
    """Read a thrust profile of the form in ``GRAMMAR``; ProfileError says what is wrong in it."""
    profile: dict[str, tuple[Waveform, ...]] = {}
    for part in text.split(','):
        dof, _, waves = (piece.strip() for piece in part.partition('='))
        if dof not in DOFS:
            near = difflib.get_close_matches(dof, DOFS, 1)
            hint = f'; did you mean {near[0]}?' if near else ''
            raise ProfileError(
                f'got DOF {dof!r}, takes {", ".join(DOFS)}, such as surge=120@0.083{hint}')
        if dof in profile:
            raise ProfileError(f'names {dof} twice; add waves with +')
        still = re.fullmatch(_NUMBER, waves) and float(waves) == 0.0
        profile[dof] = () if still else tuple(
            [_waveform(dof, wave.strip()) for wave in _PLUS.split(waves)])
    return profile


def profile_text(profile: Profile) -> str:
    """Return the text of a profile; :func:`parse_profile` reads the same profile from it."""
    return ','.join(
        f'{dof}={"+".join(map(_text, profile[dof])) or "0"}' for dof in DOFS if dof in profile)


def _waveform(dof: str, text: str) -> Waveform:
    kind, colon, rest = text.rpartition(':')
    if kind not in _FORMS:
        near = difflib.get_close_matches(kind, _FORMS, 1)
        hint = f'; did you mean {near[0]}?' if near else ''
        raise ProfileError(f'got {text!r} for {dof}, takes 120@0.083, multisine:120@0.02-0.2x12, '
                           f'steps:100@20 or 0{hint}')
    form, read = _FORMS[kind]
    try:
        return read(rest.strip())
    except ProfileError as error:
        reason = f': {error};' if str(error) else ','
        raise ProfileError(f'got {text!r} for {dof}{reason} takes {form}') from None


def _sinusoid(text: str) -> Waveform:
    amplitude, frequency = _matched(_SINUSOID, text)
    return Sinusoid(float(amplitude), float(frequency))


def _multisine(text: str) -> Waveform:
    amplitude, low, high, lines = _matched(_MULTISINE, text)
    return Multisine(float(amplitude), float(low), float(high), int(lines))


def _steps(text: str) -> Waveform:
    levels, *_, hold = _matched(_STEPS, text)
    values = [float(level) for level in levels.split('/')]
    return Steps(tuple(values if len(values) > 1 else [values[0], -values[0]]), float(hold))


def _matched(pattern: re.Pattern[str], text: str) -> tuple[str, ...]:
    found = pattern.fullmatch(text)
    if not found:
        raise ProfileError
    return found.groups()


_FORMS: dict[str, tuple[str, Callable[[str], Waveform]]] = {
    '': ('AMPLITUDE@FREQUENCY such as 120@0.083 ([N or N m] @ [Hz]), '
         'multisine:120@0.02-0.2x12, steps:100@20, or 0 for no thrust', _sinusoid),
    'multisine': ('multisine:AMPLITUDE@LOW-HIGHxLINES such as multisine:120@0.02-0.2x12 '
                  '([N or N m] @ [Hz])', _multisine),
    'steps': ('steps:LEVEL@SECONDS such as steps:100@20, which alternates, '
              'or steps:100/50/0@20 ([N or N m] @ [s])', _steps),
}


def _text(waveform: Waveform) -> str:
    if isinstance(waveform, Sinusoid):
        return f'{_number(waveform.amplitude)}@{_number(waveform.frequency)}'
    if isinstance(waveform, Multisine):
        return (f'multisine:{_number(waveform.amplitude)}@{_number(waveform.low)}-'
                f'{_number(waveform.high)}x{waveform.lines}')
    if isinstance(waveform, Steps):
        first = waveform.levels[0]
        levels = waveform.levels[:1] if waveform.levels == (first, -first) else waveform.levels
        return f'steps:{"/".join(map(_number, levels))}@{_number(waveform.hold)}'
    raise TypeError(f'{waveform!r} has no text')


def _number(value: float) -> str:
    """Return the shortest text that gives the same bits back."""
    return repr(value).removesuffix('.0')
