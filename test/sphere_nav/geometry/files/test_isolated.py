"""What a reader does to its process is one line here, and nothing of it stays."""

import tempfile
import time

import numpy as np
import pytest

from sphere_nav.geometry.files.isolated import START_BYTES, read_isolated
from worlds import isolated_readers

pytestmark = pytest.mark.dds

MEGABYTE = 1 << 20


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Nothing stays where temporary files are."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    yield
    assert list((tmp_path / "temporary").iterdir()) == []


def test_an_array_comes_back(tmp_path):
    (tmp_path / "a").write_bytes(bytes([1, 2, 3]))
    found = read_isolated(isolated_readers.read_whole, tmp_path / "a", MEGABYTE, 30.0)
    assert np.array_equal(found, np.array([1, 2, 3], np.uint8))


@pytest.mark.parametrize(
    ("reader", "line"),
    [
        ("abort", r"a: expected a whole file, found damage that ends its reader \(SIGABRT\)"),
        ("unpack", "a: expected a file that unpacks within 1 MB, found one that does not"),
    ],
)
def test_what_a_reader_dies_of_is_one_line(tmp_path, reader, line):
    (tmp_path / "a").touch()
    with pytest.raises(ValueError, match=line) as caught:
        read_isolated(getattr(isolated_readers, reader), tmp_path / "a", MEGABYTE, 30.0)
    assert "\n" not in str(caught.value)
    assert isolated_readers.UNPACKED > START_BYTES + MEGABYTE


def test_a_reader_without_end_is_ended(tmp_path):
    began = time.monotonic()
    with pytest.raises(ValueError, match="a: expected a file that is read within 1 s, found no end"):
        read_isolated(isolated_readers.wait, tmp_path / "a", MEGABYTE, 0.2)
    assert time.monotonic() - began < 5.0
