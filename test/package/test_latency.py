"""The pairing of positions and answers, which the latency benchmark measures by."""

import struct

import pytest

from test.support.answers import delays_of

STEP = 1_000_000
DOFS = ('position', 'depth', 'attitude')
LATENCY = 250_000


def sent(count: int) -> list[tuple[str, int]]:
    """Return attitudes and positions in turn, and now and then a depth."""
    messages = []
    for k in range(count):
        messages.append(('attitude', k * STEP))
        messages.append(('thrusters', k * STEP + 1))
        if k % 10 == 0:
            messages.append(('depth', k * STEP + STEP // 4))
        messages.append(('position', k * STEP + STEP // 2))
    return messages


def answers(messages: list[tuple[str, int]], lost: set[int],
            latency: int = LATENCY) -> list[tuple[int, bytes]]:
    """Return the parameters after each step but the lost ones, with what comes at first."""
    rows, counts = [[0.0] * 4 for _ in DOFS], dict.fromkeys(DOFS, 0)
    came = [(0, struct.pack('<12d', *[0.0] * 12))]
    for number, (name, time) in enumerate(messages):
        if name not in counts:
            continue
        counts[name] += 1
        if counts[name] <= 2 or number in lost:
            continue
        rows[DOFS.index(name)] = [float(number)] * 4
        came.append((time + latency, struct.pack('<12d', *[x for row in rows for x in row])))
    return came


def test_every_answer_is_that_of_its_position() -> None:
    messages = sent(100)
    assert delays_of(messages, answers(messages, set())) == [LATENCY] * 98


@pytest.mark.parametrize('latency', [LATENCY, 3 * STEP + LATENCY])  # also of a node that is behind
def test_what_was_lost_shifts_nothing(latency: int) -> None:
    messages = sent(300)
    positions = [k for k, (name, _) in enumerate(messages) if name == 'position']
    lost = {positions[20], positions[50], positions[51], positions[200]}
    assert delays_of(messages, answers(messages, lost, latency)) == [latency] * 294


def test_what_was_lost_at_the_end_shifts_nothing() -> None:
    messages = sent(300)
    end = {*range(len(messages) - 7, len(messages))}
    assert set(delays_of(messages, answers(messages, end))) == {LATENCY}


def test_an_answer_before_its_turn_counts_for_nothing_else() -> None:
    messages = sent(200)
    depth = next(k for k, (name, _) in enumerate(messages) if name == 'depth' and k > 100)
    position = messages[depth + 1]
    late = [*messages[:depth], position, ('depth', position[1] + 1), *messages[depth + 2:]]
    delays = delays_of(messages, answers(late, set()))
    assert len(delays) > 190
    assert set(delays) == {LATENCY}
