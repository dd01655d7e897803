"""Logs of other recorders: each is read, or refused in one line."""

from itertools import islice
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader, AnyReaderError
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log

READ = [
    'compat/rosbag2_cdr_test.mcap', 'compat/rosbag2_cdr_test.db3', 'compat/rosbag2_talker.mcap',
    'compat/rosbag2_talker.db3', 'compat/rerun_rosbag2_2025_09_10.mcap',
    'compat/robot_localization_0559965.bag', 'compat/fg_example-lz4.bag',
    'bluerov2_tank/all_axes.mcap', 'bluerov2_tank/surge_sway_heave.mcap',
]


@pytest.mark.long
@pytest.mark.parametrize('name', READ)
def test_every_topic_as_another_reader_gives_it(name: str, data: Path) -> None:
    with AnyReader([data / name]) as reader, Log([data / name]) as log:
        assert log.warnings == []
        assert {topic: (info.type, info.count) for topic, info in log.topics.items()} == {
            topic: (info.msgtype, info.msgcount) for topic, info in reader.topics.items()}
        assert (log.start, log.end + 1) == (reader.start_time, reader.end_time)
        for topic in log.topics:
            theirs = [
                (time, raw, connection.msgtype) for connection, time, raw in
                reader.messages([c for c in reader.connections if c.topic == topic])
            ] if log.topics[topic].count else []
            assert [(raw.time, raw.data) for raw in log.raw([topic])] == [
                (time, raw) for time, raw, _ in theirs]
            try:
                ours = [repr(message.data) for message in islice(log.messages([topic]), 50)]
            except LogError as error:
                assert f'{name}: {topic} (' in str(error)
                with pytest.raises(AnyReaderError):
                    reader.deserialize(*theirs[0][1:])
            else:
                assert ours == [_decoded(reader, *raw) for _, *raw in theirs[:50]]


def _decoded(reader: AnyReader, raw: bytes, kind: str) -> str:
    """Decode by another reader, which refuses a message with more behind it."""
    while True:
        try:
            return repr(reader.deserialize(raw, kind))
        except AnyReaderError as error:
            assert 'size mismatch' in str(error)
            raw = raw[:-1]


@pytest.mark.parametrize('name', ['fg_no-messages.bag', 'rosbag2_empty.db3'])
def test_an_empty_log_is_refused(name: str, data: Path) -> None:
    with pytest.raises(LogError) as refused:
        Log([data / 'compat' / name])
    assert str(refused.value) == f'{data}/compat/{name}: holds no messages'


def test_an_unknown_encoding_is_refused(data: Path) -> None:
    with Log([data / 'compat' / 'rosbag2_wrong_rmw.mcap']) as log:
        with pytest.raises(LogError, match="/test_topic is encoded as 'wrong_format'"):
            list(log.messages(['/test_topic']))


def test_a_log_without_the_topic_says_what_it_has(data: Path) -> None:
    with Log([data / 'bluerov2_tank' / 'all_axes.mcap']) as log:
        with pytest.raises(LogError) as refused:
            log.require({'/mocap/poses': ''})
    assert str(refused.value).endswith(
        'no messages on /mocap/poses; it has /mocap/pose, /mocap/velocity, /rc/command; '
        "did you mean '/mocap/pose'?")


def test_ros1_messages_have_the_fields_that_ros2_ones_have(data: Path) -> None:
    with Log([data / 'compat' / 'robot_localization_0559965.bag']) as log:
        odometry = next(log.messages(['/jackal_velocity_controller/odom']))
        assert odometry.type == 'nav_msgs/msg/Odometry'
        assert odometry.data.header.stamp.sec == odometry.time // 10**9
        assert odometry.data.child_frame_id == 'base_link'
        assert len(log.blank('/imu/data').orientation_covariance) == 9
