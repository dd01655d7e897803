"""How much an object keeps, without a look at what its attributes are called."""

from __future__ import annotations

from array import array
from collections import deque
import gc
from types import FunctionType, ModuleType
from typing import Any


def lengths(kept_by: Any) -> list[int]:
    """Return the lengths of all arrays, lists, deques, sets and dicts that an object leads to."""
    found: list[int] = []
    seen: set[int] = set()
    waiting = [kept_by]
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, type | ModuleType | FunctionType):
            continue
        seen.add(id(one))
        if isinstance(one, array | list | deque | set | dict):
            found.append(len(one))
        waiting += gc.get_referents(one)
    return found
