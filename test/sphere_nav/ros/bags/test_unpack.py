"""Compressed data: nothing is unpacked beyond a limit, whatever is said of its size."""

import bz2

import lz4.frame
import pytest
import zstandard

from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.unpack import unpack, unpack_file

PLAIN = bytes(range(256)) * 4


def zstd(data, *, is_told=True):
    return zstandard.ZstdCompressor(write_content_size=is_told).compress(data)


PACK = {"zstd": zstd, "lz4": lz4.frame.compress, "bz2": bz2.compress, "": bytes}


@pytest.mark.parametrize("method", PACK)
def test_what_was_packed_comes_back(method):
    assert unpack(PACK[method](PLAIN), method, len(PLAIN)) == PLAIN


def test_a_method_that_nobody_knows_and_damage():
    with pytest.raises(BagError, match="compression: expected zstd, lz4, bz2 or none, found 'brotli'"):
        unpack(b"", "brotli", 10)
    for method in ("zstd", "lz4", "bz2"):
        with pytest.raises(BagError, match=f"expected {method} data, found damage"):
            unpack(b"not that", method, 10)
        with pytest.raises(BagError, match=f"expected {method} data, found damage"):
            unpack(PACK[method](PLAIN)[:40], method, len(PLAIN))


def test_a_file_is_unpacked_within_limits(tmp_path, monkeypatch):
    packed, plain = tmp_path / "a.zstd", tmp_path / "a"
    packed.write_bytes(zstd(PLAIN) + zstd(PLAIN))
    unpack_file(packed, plain)
    assert plain.read_bytes() == PLAIN + PLAIN
    monkeypatch.setattr("sphere_nav.ros.bags.unpack.MAX_WINDOW", 1 << 23)
    packed.write_bytes(zstd(bytes(1 << 24)))
    with pytest.raises(BagError, match=r"a\.zstd: expected at most 8388608 bytes after decompression, found more"):
        unpack_file(packed, plain)
    assert plain.stat().st_size <= 1 << 23
    packed.write_bytes(b"not that")
    with pytest.raises(BagError, match=r"a\.zstd: expected zstd data, found damage"):
        unpack_file(packed, plain)
