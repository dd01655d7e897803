"""Serialised messages to events, with only what the inputs need decoded where that can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rovid_core.model.samples import Event
from rovid_ros.messages.convert import Access, Converter, STAMP
from rovid_ros.messages.sample_readers import RefusedError
from rovid_ros.messages.types import WireType
from rovid_ros.messages.wire_layout import NoLayoutError, walk

ATTEMPTS = 100
"""Layouts to look for on one topic: where they change that often, they are of no use."""


class Unpacker:
    """
    Make events of the serialised messages of one topic.

    A message is decoded as a whole, and converted, unless it has the layout of one that was:
    then its values are read from where they were, to the same bits. What cannot be decoded is
    left to the decoder, also a message that lacks its end.

    Parameters
    ----------
    converter : Converter
        Knows the inputs.
    topic : str
        As in ``converter.topics``.
    wire : WireType
        How the messages are written, by the definition that comes with them.
    decode : callable
        From bytes to a message; what it raises is passed on.

    """

    def __init__(self, converter: Converter, topic: str, wire: WireType,
                 decode: Callable[[bytes], Any]) -> None:
        self._converter = converter
        self._topic = topic
        self._wire = wire
        self._decode = decode
        self._left = ATTEMPTS
        self._known: dict[int, _Known] = {}  # by the length of the message

    def events(self, data: bytes, receive_time: int, origin: Any = None) -> list[Event]:
        """
        Convert a message.

        Parameters
        ----------
        data : bytes
            The message.
        receive_time, origin
            As in ``Converter.events``.

        """
        known = self._known.get(len(data))
        if known is not None:
            fits, shape, accesses = known
            if fits(data) == shape:
                return self._converter.read(accesses, data, receive_time, origin)
        message = self._decode(data)
        events = self._converter.events(self._topic, message, receive_time, origin)
        if self._left:
            self._left -= 1
            self._learn(data, message)
        return events

    def _learn(self, data: bytes, message: Any) -> None:
        """Remember the layout of a message, if it gives what the whole message gives."""
        decoded = self._converter.accesses(self._topic, message)
        if not decoded:
            return
        try:
            layout = walk(self._wire, data)
            stamp = layout.fetch([name.split('.') for name in STAMP]) if any(
                access.stamp for access in decoded) else None
            accesses = [
                replace(access, fetch=layout.fetch(access.reading.paths),
                        stamp=stamp if access.stamp else None) for access in decoded]
        except NoLayoutError:
            return
        if [_given(access, data) for access in accesses] == [
                _given(access, message) for access in decoded]:
            self._known[len(data)] = layout.fits, layout.fits(data), accesses


_Known = tuple[Callable[[bytes], tuple[Any, ...]], tuple[Any, ...], list[Access]]


def _given(access: Access, message: Any) -> str:
    """Return in a comparable form what an input gets."""
    try:
        value: Any = access.value(message)
    except (RefusedError, IndexError) as refused:
        value = refused
    return repr((value, access.stamp(message) if access.stamp else None))
