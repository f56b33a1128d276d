"""Only regular files are opened, up to a size, and at once."""

import os

import pytest

from sphere_nav.geometry.files.untrusted import open_file, read_bytes, read_text


def test_a_file_is_read_whole_with_its_line_ends_alike(tmp_path):
    path = tmp_path / "text"
    path.write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    assert read_text(path, "table") == "a\nb\nc\n"
    assert read_bytes(path, "table", 100) == path.read_bytes()
    with open_file(str(path), "table", 100) as file:
        assert file.read(3) == b"\xef\xbb\xbf"


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "endless").symlink_to("/dev/zero")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    for name, found in (("fifo", "a FIFO"), ("endless", "no regular file"), ("absent", "no such file")):
        with pytest.raises(ValueError, match=f"{name}: expected a table, found {found}"):
            read_bytes(tmp_path / name, "table", 100)
    with pytest.raises(ValueError, match="expected a table, found a folder"):
        read_text(tmp_path, "table")
    with pytest.raises(ValueError, match="expected a table, found no such file"):
        read_text(tmp_path / "fifo" / "beneath", "table")
    with pytest.raises(OSError, match="symbolic links"):
        read_text(tmp_path / "circle", "table")
