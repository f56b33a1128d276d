"""Arrays in a folder: whole or not at all, the last writer wins."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.likeness.depth_cache import load_arrays, save_arrays


def test_the_last_to_write_wins_and_leaves_nothing_beside(tmp_path):
    for value in (1, 2):
        save_arrays(tmp_path / "kept" / "a", {"numbers": np.full(3, value), "width": np.array(7)})
    numbers, width = load_arrays(tmp_path / "kept" / "a", ("numbers", "width"))
    np.testing.assert_array_equal(numbers, 2)
    assert int(width) == 7
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["a"]
    assert load_arrays(tmp_path / "kept" / "b", ("numbers",)) is None


def test_an_array_that_is_absent_or_damaged_is_named(tmp_path):
    save_arrays(tmp_path / "a", {"numbers": np.zeros(3)})
    with pytest.raises(ValueError, match=r"a: expected a cache of depth features"):
        load_arrays(tmp_path / "a", ("numbers", "other"))
    (tmp_path / "a" / "numbers.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(ValueError, match=r"a: expected a cache of depth features"):
        load_arrays(tmp_path / "a", ("numbers",))
