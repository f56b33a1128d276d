"""A file is the old one or the new one, never a part of either."""

import os

import pytest

from sphere_nav.geometry.files.whole_file import PART, write_whole


def test_a_text_takes_the_place_of_another(tmp_path):
    path = tmp_path / "a.json"
    for text in ("first", "größer"):
        write_whole(path, text)
        assert path.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [path]


def test_what_ends_it_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    write_whole(path, "old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, "new")
    assert path.read_text(encoding="utf-8") == "old"
    assert {one.name for one in tmp_path.iterdir()} == {"a.json", "a.json" + PART}
