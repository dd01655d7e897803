"""The writer against the format's own package, byte for byte."""

from io import BytesIO
import random

from mcap.writer import Writer
import pytest
from rovid_ros.logs.mcap_writer import McapWriter

CHUNK = 5000


@pytest.mark.parametrize('count', [0, 1, 5, 1000])
def test_the_file_is_that_of_the_package(count: int) -> None:
    draw = random.Random(count)
    expected, written = BytesIO(), BytesIO()
    theirs = Writer(expected, chunk_size=CHUNK)
    theirs.start(profile='ros2', library='rovid')
    ours = McapWriter(written, CHUNK)
    channels: list[int] = []
    for number in range(count):
        what = draw.random()
        if not channels or what < 0.02:
            text, topic = draw.randbytes(draw.randrange(2 * CHUNK)), f'/topic{number}'
            schema = theirs.register_schema('T', 'ros2msg', text)
            assert ours.add_schema('T', text) == schema
            channels.append(theirs.register_channel(topic, 'cdr', schema, {'qos': 'é'}))
            assert ours.add_channel(topic, schema, {'qos': 'é'}) == channels[-1]
        elif what < 0.04:
            theirs.add_metadata('state', {'key': topic})
            ours.add_metadata('state', {'key': topic})
        elif what < 0.06:
            theirs.flush()
            ours.flush()
        channel, data = draw.choice(channels), draw.randbytes(draw.randrange(100))
        time, publish_time = draw.randrange(1 << 62), draw.randrange(1 << 62)
        theirs.add_message(channel, time, data, publish_time)
        ours.add_messages([channel], [data], time, publish_time)
    theirs.finish()
    ours.finish()
    assert written.getvalue() == expected.getvalue()
