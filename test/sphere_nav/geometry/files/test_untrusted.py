"""Numbers of text formats are finite, bounded and exact, whatever is written there."""

import os
import time

import numpy as np
import pytest

from sphere_nav.geometry.files.untrusted import (
    load_yaml,
    number,
    numbers,
    open_file,
    parse_stamp_ns,
    read_bytes,
    read_npy,
    read_text,
)


def test_a_number_however_it_is_written_a_list_of_the_length_asked_for_and_what_is_none():
    for found in [1, 1.0, "1", "1e0", " 1 "]:
        assert number(found, "x") == 1.0
    for found in ["nan", "", [1], 10**5000, "9" * 100]:
        with pytest.raises(ValueError, match="x: expected a finite number") as caught:
            number(found, "x")
        assert len(str(caught.value)) < 150
    assert numbers([1, "2"], "x", 2) == (1.0, 2.0)
    for found in ([1], [1, 2, 3], "12", None):
        with pytest.raises(ValueError, match="x: expected"):
            numbers(found, "x", 2)


def test_a_stamp_keeps_its_nanoseconds_and_one_that_no_clock_gives_is_refused():
    for word, ns in [("1700000000.123456789", 1_700_000_000_123_456_789), ("0", 0), ("1e-9", 1)]:
        assert parse_stamp_ns(word, "x") == ns
    for word in ["1e999999999", "-1", "nan", "one", "2147483648"]:
        with pytest.raises(ValueError, match="x: expected"):
            parse_stamp_ns(word, "x")
    with pytest.raises(ValueError, match=r"nanoseconds\?"):
        parse_stamp_ns("1700000000000000000", "x")


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
    for name, found in (("fifo", "a FIFO"), ("endless", "no regular file"), ("absent", "no such file")):
        with pytest.raises(ValueError, match=f"{name}: expected a table, found {found}"):
            read_bytes(tmp_path / name, "table", 100)
    with pytest.raises(ValueError, match="expected a table, found a folder"):
        read_text(tmp_path, "table")


def test_an_array_is_read_and_a_damaged_one_is_named(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(3.0))
    assert read_npy(tmp_path / "a.npy", "array").tolist() == [0.0, 1.0, 2.0]
    (tmp_path / "b.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-1])
    with pytest.raises(ValueError, match=r"b\.npy: expected an array, found a file that is none \(.+\)"):
        read_npy(tmp_path / "b.npy", "array")


def test_values_are_read_and_aliases_and_merge_keys_written_out():
    assert load_yaml("x", "a: 1\nb: [1.5, two]\nc: {d: null}") == {"a": 1, "b": [1.5, "two"], "c": {"d": None}}
    text = "near: &near {gain: 1.0, names: &n [a, b]}\nfar:\n  <<: *near\n  gain: 2.0\nlist: [*n, *n]"
    assert load_yaml("x", text) == {
        "near": {"gain": 1.0, "names": ["a", "b"]},
        "far": {"gain": 2.0, "names": ["a", "b"]},
        "list": [["a", "b"], ["a", "b"]],
    }


def bomb(first, form, width=10, levels=8):
    """Return a text whose values say ten times those before."""
    lines = [f"a0: &a0 {first}"]
    for n in range(levels):
        lines.append(f"a{n + 1}: &a{n + 1} " + form.format(", ".join([f"*a{n}"] * width)))
    return "\n".join(lines)


def test_anything_else_is_one_line_at_once():
    for text, expected in [
        ("a: &a [1, *a]", r"line 1: an alias \(\*a\) in what has an anchor"),
        (bomb("{k: 1}", "{{<<: [{}]}}"), r"line 2: an alias \(\*a0\) in what has an anchor"),
        ("a: 1\na: 2", "'a' twice"),
        ("? [1, 2]\n: 3", "unhashable"),
        ("- " * 100_000 + "1", "more than 32 levels"),
        ("a: 2026-99-99", "month must be in"),
        ("a: 1\n---\nb: 2", "expected a single document"),
    ]:
        started = time.process_time()
        with pytest.raises(ValueError, match=expected) as caught:
            load_yaml("x", text)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 400
        assert time.process_time() - started < 2.0
