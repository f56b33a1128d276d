"""YAML from outside is small, flat, and says everything once."""

import time

import pytest

from sphere_nav.geometry.files.untrusted import load_yaml


def test_values_are_read():
    assert load_yaml("x", "a: 1\nb: [1.5, two]\nc: {d: null}") == {"a": 1, "b": [1.5, "two"], "c": {"d": None}}


def test_aliases_and_merge_keys_are_written_out():
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
