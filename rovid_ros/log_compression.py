"""The compression of chunks, also of damaged ones."""

from __future__ import annotations

import bz2
from typing import Any

import lz4.frame
from rovid_ros.log_container import LogError
import zstandard

_PIECE = 1024  # [bytes]; what one damaged piece costs when a chunk cannot be had whole


def inflate(data: bytes, compression: str, name: str) -> bytes:
    """
    Decompress a chunk, or as much of it as can be had.

    Parameters
    ----------
    data : bytes
        May lack its end or be damaged.
    compression : str
        '', none, zstd, lz4 or bz2.
    name : str
        The file, for the error.

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
    try:
        whole: bytes = _DECOMPRESSORS[compression]().decompress(data)
        return whole
    except _DAMAGE:
        pass
    decompressor = _DECOMPRESSORS[compression]()
    pieces = []
    try:
        for position in range(0, len(data), _PIECE):
            pieces.append(decompressor.decompress(data[position:position + _PIECE]))
    except _DAMAGE:
        pass
    return b''.join(pieces)


_DAMAGE = (zstandard.ZstdError, RuntimeError, OSError, EOFError)
_DECOMPRESSORS: dict[str, Any] = {
    'zstd': lambda: zstandard.ZstdDecompressor().decompressobj(),
    'lz4': lz4.frame.LZ4FrameDecompressor,
    'bz2': bz2.BZ2Decompressor,
}
