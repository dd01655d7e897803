"""How large a message type may be that a log defines: types without end are easily written."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

LARGEST_DEFINITION = 1 << 17
"""[characters] Of a type with all that is in it; large ones have 20,000."""

MOST_VALUES = 100_000
"""Numbers and texts in a message whose sequences are empty."""

DEEPEST = 32
"""Messages within messages."""

_NOTHING = 'structure_needs_at_least_one_member'  # in ROS 1 it does without


class EndlessTypeError(ValueError):
    """A definition that no message needs; the text says why."""


def count_values(store: Typestore, name: str) -> int:
    """
    Return how many values a blank message holds, a sequence counted as one.

    Raises
    ------
    EndlessTypeError
        If it holds too many, or itself, or sequences of something that takes no bytes.
    KeyError
        If the store lacks a type.

    """
    return _count(store, name, (), {})


def _count(store: Typestore, name: str, within: tuple[str, ...], known: dict[str, int]) -> int:
    if name in within:
        raise EndlessTypeError(f'{name} is in itself')
    if len(within) >= DEEPEST:
        raise EndlessTypeError(f'more than {DEEPEST} messages within each other')
    if name not in known:
        total = 0
        for field, (node, detail) in store.fielddefs[name][1]:
            if field != _NOTHING:
                total += _count_field(store, node, detail, (*within, name), known)
        if total > MOST_VALUES:
            raise EndlessTypeError(f'more than {MOST_VALUES:,} values in {name}')
        known[name] = total
    return known[name]


def _count_field(store: Typestore, node: Nodetype, detail: Any, within: tuple[str, ...],
                 known: dict[str, int]) -> int:
    if node == Nodetype.NAME:
        return _count(store, detail, within, known)
    if node == Nodetype.BASE:
        return 1
    (inner, inner_detail), size = detail
    each = _count_field(store, inner, inner_detail, within, known)
    if node == Nodetype.ARRAY:
        return each * int(size)
    if each == 0:
        raise EndlessTypeError('a sequence of nothing')
    return 1
