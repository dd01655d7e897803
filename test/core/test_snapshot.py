"""What a snapshot can hold comes back bit for bit; what it can not is told when it is taken."""

from array import array
from collections import deque
import json
import math
from pathlib import Path
import struct
from typing import Any

from hypothesis import given, strategies as st
import numpy as np
import pytest
from rovid_core.inputs.units_and_signs import TypicalSizeCheck
from rovid_core.model.samples import Event, Sample
from rovid_core.snapshot import SnapshotError, Snapshots


def holder(**attributes: Any) -> TypicalSizeCheck:
    """Return an object of the project with attributes of any kind."""
    made = TypicalSizeCheck.__new__(TypicalSizeCheck)
    vars(made).update(attributes)
    return made


def there_and_back(value: Any) -> Any:
    """Return a value as it comes back into an object that had None."""
    event = Event(0, ())  # so that there is one at first
    taken = json.dumps(Snapshots({'x': holder(e=event, v=value)}).take(), allow_nan=False)
    target = holder(e=event, v=None)
    snapshots = Snapshots({'x': target})
    snapshots.put_back(json.loads(taken))
    return target.v


def bits(x: float) -> bytes:
    return struct.pack('>d', x)


@given(st.integers(0, 2**64 - 1))
def test_every_float_keeps_its_bits(number: int) -> None:
    (value,) = struct.unpack('>d', number.to_bytes(8, 'big'))
    assert bits(there_and_back(value)) == bits(value)
    assert bits(there_and_back([(value, 1)])[0][0]) == bits(value)


@pytest.mark.parametrize('value', [
    None, True, 0, -(2**70), 'text \ud83d\udea2'[:6], -0.0, (), (1, (2.5, 'a')), [], [[1], (2,)],
    {}, {('a', 0): [1], 'b': {}}, deque([1, 2]), deque([1, 2], maxlen=3), {1, (2, 3)},
    frozenset({('a', 0)}), Event(5, (Sample('depth', (1.0,)),))])
def test_plain_values_come_back(value: Any) -> None:
    found = there_and_back(value)
    assert found == value
    assert type(found) is type(value)
    assert repr(found) == repr(value)
    if isinstance(value, deque):
        assert found.maxlen == value.maxlen


@pytest.mark.parametrize('value', [
    np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    np.array([math.nan, -0.0, math.inf]), np.zeros((0, 4)), np.array(3), np.array([True, False]),
    np.arange(3, dtype=np.int32), array('q', [1, -2]), array('d', [math.nan, -0.0])])
def test_arrays_come_back(value: Any) -> None:
    found = there_and_back(value)
    assert found.tobytes() == value.tobytes()
    if isinstance(value, np.ndarray):
        assert (found.dtype, found.shape) == (value.dtype, value.shape)
        assert found.strides == value.strides or not value.size
        assert found.flags.writeable
    else:
        assert found.typecode == value.typecode


def test_numpy_numbers_stay_numpy_numbers() -> None:
    found = there_and_back(np.float64(-0.0))
    assert type(found) is np.float64
    assert bits(float(found)) == bits(-0.0)


def test_what_is_shared_is_shared_again() -> None:
    one, matrix = [1.0], np.eye(2)
    found = there_and_back({'a': one, 'b': (one, [one]), 'c': matrix, 'd': [matrix]})
    assert found['a'] is found['b'][0] is found['b'][1][0]
    assert found['c'] is found['d'][0]
    loop: list[Any] = []
    loop.append(loop)
    found = there_and_back(loop)
    assert found[0] is found


def test_what_others_hold_on_to_stays_the_same_object() -> None:
    lines = ['a', 'b']
    taken = Snapshots({'x': holder(lines=lines, say=lines.append)}).take()
    other: list[str] = []
    target = holder(lines=other, say=other.append)
    snapshots = Snapshots({'x': target})
    snapshots.put_back(taken)
    target.say('c')
    assert target.lines == ['a', 'b', 'c']


MATRIX = np.eye(3)


@pytest.mark.parametrize('value, says', [
    (object(), 'x.v is builtins.object'), (b'bytes', 'x.v is builtins.bytes'),
    ([1, {'k': (0, 1j)}], "x.v[1]['k'][1] is builtins.complex"),
    (iter(()), 'x.v is builtins.tuple_iterator'), (Path('p'), 'x.v is pathlib'),
    (np.array([None]), 'x.v is an array'), (MATRIX[:, ::2], 'x.v is an array'),
    ([MATRIX, MATRIX[0]], 'x.v[1] is a view of another array')])
def test_what_cannot_come_back_is_told_with_its_place(value: Any, says: str) -> None:
    with pytest.raises(TypeError) as told:
        Snapshots({'x': holder(v=value)})
    assert says in str(told.value)
    target = holder(v=None)
    snapshots = Snapshots({'x': target})
    target.v = value
    with pytest.raises(TypeError) as told:
        snapshots.take()
    assert says in str(told.value)


def test_what_was_not_there_at_first_is_told() -> None:
    target = holder(v=None)
    snapshots = Snapshots({'x': target})
    target.v = Event(1, ())
    with pytest.raises(TypeError, match='x.v is rovid_core.model.samples.Event, which nothing'):
        snapshots.take()
    target.v = None
    vars(target)['late'] = 1
    with pytest.raises(TypeError, match='x has not always had the same attributes: late'):
        snapshots.take()


@pytest.mark.parametrize('node', [
    5, {'list': []}, {'same': 1}, {'object': ['rovid_core.watch.TypicalSizes', {}]},
    {'object': ['rovid_core.watch.TypicalSizes', {'v': 1.0, 'w': 2}]},
    {'object': ['os.system', {'v': 1.0}]}, {'object': ['rovid_core.plant.Plant', {'v': 1.0}]},
    {'value': ['rovid_core.watch.TypicalSizes', 1.0]},
    *({'object': ['rovid_core.watch.TypicalSizes', {'v': wrong}]} for wrong in (
        'text', {'kept': 'code'}, {'float': 'xyz'}, {'float': '00'}, {'same': 9}, {'what': 1},
        {'list': 5}, {'list': [], 'dict': []}, {'array': ['Z', '']}, {'array': ['d', 'AAA=']},
        {'ndarray': ['|O', [1], 'C', 'AAAAAAAAAAA=']}, {'ndarray': ['<f8', [9], 'C', '']},
        {'set': [{'list': []}]}, {'value': ['rovid_core.values.Event', 1]}, {'deque': [-1, []]}))])
def test_what_no_walk_has_made_is_refused(node: Any) -> None:
    target = holder(v=0.5)
    snapshots = Snapshots({'x': target})
    with pytest.raises(SnapshotError):
        snapshots.put_back({'x': node})
    assert vars(target) == {'v': 0.5}


def test_deep_nesting_is_refused() -> None:
    node: Any = []
    for _ in range(100_000):
        node = [node]
    with pytest.raises(SnapshotError):
        Snapshots({'x': holder(v=0.5)}).put_back(
            {'x': {'object': ['rovid_core.watch.TypicalSizes', {'v': node}]}})
    while node:  # or the interpreter would fall into it
        node = node.pop()
