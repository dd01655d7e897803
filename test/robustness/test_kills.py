"""``kill -9`` leaves whole files, and the next run goes on from them."""

from pathlib import Path

import pytest

from test.support.replay_kills import replay_kills


@pytest.mark.long
def test_killed_replays(tmp_path: Path) -> None:
    tally = replay_kills(tmp_path, 2, seed=3, duration=25.0)
    assert tally.faults == []
    assert tally.kills >= 2
    assert tally.states > 0
    assert tally.messages > 0
    assert tally.finished > 0


@pytest.mark.long
def test_killed_nodes(tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    from test.support.live_kills import live_kills
    tally = live_kills(tmp_path, 3, seed=2)
    assert tally.faults == []
    assert tally.kills == 3
    assert tally.states > 0
    assert tally.messages > 0
