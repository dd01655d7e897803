"""What ROS' parameter reader (rcl) makes of a scalar without quotes."""

from __future__ import annotations

import math
import re
import sys

Scalar = bool | int | float | str

TRUE = {'Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'}
FALSE = {'N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'}

# what C's strtol (base 0) and strtod take whole
INTEGER = re.compile(r'\s*([+-]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]*))', re.ASCII)
DECIMAL = re.compile(r'\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?', re.ASCII)
HEXADECIMAL = re.compile(
    r'\s*[+-]?0[xX]([0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?', re.ASCII)
NAMED = re.compile(r'\s*[+-]?(?i:inf|infinity|nan(?:\(\w*\))?)', re.ASCII)
# what rcl adds
DOTTED = re.compile(r'[+-]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)')


def scalar(text: str) -> Scalar:
    """
    Return the bool, integer, number or text that rcl reads.

    There is no null (``~`` is text), ``010`` is 8, ``08`` is 8.0, ``1e-5`` is a number,
    ``1_000`` is text, and so is a number that does not fit.
    """
    if text in TRUE or text in FALSE:
        return text in TRUE
    integer = _integer(text)
    if integer is not None:
        return integer
    number = _number(text)
    return text if number is None else number


def _integer(text: str) -> int | None:
    match = INTEGER.fullmatch(text)
    if not match:
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    digits, base = (hexadecimal, 16) if hexadecimal else (octal, 8) if octal else (decimal, 10)
    if len(digits) > 64:
        return None
    value = int(sign + digits, base)
    return value if -2**63 <= value < 2**63 else None


def _number(text: str) -> float | None:
    if NAMED.fullmatch(text) or DOTTED.fullmatch(text):
        return float(text.replace('.', '').partition('(')[0])
    decimal, hexadecimal = DECIMAL.fullmatch(text), HEXADECIMAL.fullmatch(text)
    match = decimal or hexadecimal
    if not match:
        return None
    try:
        value = float(text) if decimal else float.fromhex(text)
    except OverflowError:
        return None
    too_small = abs(value) < sys.float_info.min and match.group(1).strip('0.')
    return None if math.isinf(value) or too_small else value
