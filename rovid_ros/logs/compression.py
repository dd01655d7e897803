"""Decompression of a log's chunks, also of damaged ones, and of none without end."""

from __future__ import annotations

import bz2
from typing import Any

import lz4.frame
from rovid_ros.logs.container import LARGEST, LogError
import zstandard

_PIECE = 1024  # [bytes]; what one damaged piece costs when a chunk cannot be had whole


def inflate(data: bytes, compression: str, name: str, size: int) -> bytes:
    """
    Decompress a chunk, or as much of it as can be had.

    No more comes out than one byte beyond what it says, nor than ``LARGEST``.

    Parameters
    ----------
    data : bytes
        May lack its end or be damaged.
    compression : str
        '', none, zstd, lz4 or bz2.
    name : str
        The file, for the error.
    size : int
        What the chunk says that is in it [bytes].

    Raises
    ------
    LogError
        If the compression is another.

    """
    if compression in ('', 'none'):
        return data
    if compression not in _DECOMPRESSORS:
        raise LogError(f'{name}: its chunks are compressed as {compression!r}; '
                       f'{", ".join(_DECOMPRESSORS)} can be read')
    most = min(size, LARGEST) + 1
    try:
        if compression == 'zstd':
            return zstandard.ZstdDecompressor().stream_reader(data).read(most)
        whole: bytes = _DECOMPRESSORS[compression]().decompress(data, max_length=most)
        return whole
    except _DAMAGE:
        pass
    decompressor = _DECOMPRESSORS[compression]()
    pieces, left = [], most
    try:
        for position in range(0, len(data), _PIECE):
            piece = decompressor.decompress(data[position:position + _PIECE])
            pieces.append(piece[:left])
            left -= len(piece)
            if left <= 0:
                break
    except _DAMAGE:
        pass
    return b''.join(pieces)


_DAMAGE = (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError)
_DECOMPRESSORS: dict[str, Any] = {
    'zstd': lambda: zstandard.ZstdDecompressor().decompressobj(),
    'lz4': lz4.frame.LZ4FrameDecompressor,
    'bz2': bz2.BZ2Decompressor,
}
