"""Arrays in a folder: whole or not at all, the last writer wins."""

from __future__ import annotations

import numpy as np

from mcl_depth.likeness.depth_cache import load_arrays, save_arrays


def test_the_last_to_write_wins_and_leaves_nothing_beside(tmp_path):
    for value in (1, 2):
        save_arrays(tmp_path / "kept" / "a", {"numbers": np.full(3, value), "width": np.array(7)})
    numbers, width = load_arrays(tmp_path / "kept" / "a", ("numbers", "width"))
    np.testing.assert_array_equal(numbers, 2)
    assert int(width) == 7
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["a"]
    assert load_arrays(tmp_path / "kept" / "b", ("numbers",)) is None
