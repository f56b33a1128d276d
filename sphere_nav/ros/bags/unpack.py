"""Compressed data from files of anyone: nothing is unpacked beyond a limit, whatever its header says."""

from __future__ import annotations

import bz2
import shutil
from pathlib import Path
from typing import Any

import zstandard

from sphere_nav.geometry.files.untrusted import printable, short
from sphere_nav.ros.bags.recorded import BagError

MAX_WINDOW = 1 << 28  # bytes that a decompressor keeps
BLOCK = 1 << 20  # bytes of a file at once
MAX_RATIO = 1000  # of a file to what is packed in it
FREE_SHARE = 0.9  # of the free disk that a file may fill


def unpack(data: bytes, compression: str, max_size: int) -> bytes:
    """Return what was compressed; BagError for damage, an unknown method, or more than `max_size` bytes."""
    try:
        if compression == "zstd":
            told = zstandard.frame_content_size(data)
            if told > max_size:
                raise BagError(f"expected at most {max_size} bytes after decompression, found {told}")
            return zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW).decompress(data, max_output_size=max_size + 1)
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor  # rare

            return _whole(LZ4FrameDecompressor(), data, max_size)
        if compression == "bz2":
            return _whole(bz2.BZ2Decompressor(), data, max_size)
    except (zstandard.ZstdError, RuntimeError, EOFError, OSError) as error:
        raise BagError(f"expected {compression} data, found damage: {printable(str(error))}") from None
    if compression:
        raise BagError(f"compression: expected zstd, lz4, bz2 or none, found {short(compression)}")
    return data


def unpack_file(source: Path, target: Path) -> None:
    """Write what a file of zstd holds, as long as the disk holds it; BagError for damage or an absurd size."""
    free = int(FREE_SHARE * shutil.disk_usage(target.parent).free)
    limit = min(max(MAX_WINDOW, MAX_RATIO * source.stat().st_size), free)
    try:
        with source.open("rb") as packed, target.open("wb") as plain:
            reader = zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW).stream_reader(
                packed, read_across_frames=True
            )
            while block := reader.read(BLOCK):
                if plain.tell() + len(block) > limit:
                    raise BagError(f"{source}: expected at most {limit} bytes after decompression, found more")
                plain.write(block)
    except zstandard.ZstdError as error:
        raise BagError(f"{source}: expected zstd data, found damage: {printable(str(error))}") from None


def _whole(decompressor: Any, data: bytes, max_size: int) -> bytes:
    plain: bytes = decompressor.decompress(data, max_size + 1)
    if len(plain) > max_size:
        raise BagError(f"expected at most {max_size} bytes after decompression, found more")
    if not decompressor.eof:
        raise EOFError("no end")
    return plain
