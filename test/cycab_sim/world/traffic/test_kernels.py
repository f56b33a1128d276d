import numpy as np
import pytest

from cycab_sim.world.mesh import moved, placed
from cycab_sim.world.traffic import kernels


def test_parts_are_placed_with_their_texture(rng):
    triangles = rng.normal(size=(4, 3, 3)).astype(np.float32)
    normals = rng.normal(size=(4, 3)).astype(np.float32)
    frames = rng.normal(size=(2, 3, 4)).astype(np.float32)
    poses = np.stack([placed(3.0, -2.0, 0.7, 0.5), placed(-1.0, 4.0, 2.0)])
    out = triangles.copy(), normals.copy(), frames.copy()
    kernels.place_parts(poses, np.array([0, 0, 1, 1]), np.array([0, 1]), (triangles, normals, frames), out)
    for t, part in enumerate((0, 0, 1, 1)):
        np.testing.assert_allclose(out[0][t], moved(triangles[t], poses[part]), atol=1e-5)
        np.testing.assert_allclose(out[1][t], poses[part, :3, :3] @ normals[t], atol=1e-5)
    for s in (0, 1):  # a point keeps its place in the texture
        before = frames[s, :, :3] @ triangles[2 * s, 0] + frames[s, :, 3]
        after = out[2][s, :, :3] @ out[0][2 * s, 0] + out[2][s, :, 3]
        np.testing.assert_allclose(after, before, atol=1e-5)


def test_a_shadow_is_drawn_and_taken_away():
    still = np.full((40, 40), 9.0, np.float32)
    shadow, windows = still.copy(), np.empty((1, 4), np.int32)
    triangle = np.array([[[1.0, 1.0, 4.0], [3.0, 1.0, 4.0], [1.0, 3.0, 5.0]]], np.float32)
    kernels.cast_shadows(triangle, np.eye(3), np.zeros(2), 0.1, windows, shadow)
    assert shadow[15, 15] == pytest.approx(4.25)  # row y, column x; the depth rises with y
    assert shadow[29, 29] == 9.0  # beyond the long side
    assert shadow[5, 15] == 9.0
    assert (shadow < 9.0).sum() == pytest.approx(200, rel=0.2)  # 2 m^2 in texels, and a fringe
    kernels.erase_shadows(windows, still, shadow)
    np.testing.assert_array_equal(shadow, still)


def test_what_lies_beyond_the_map_has_no_shadow_there():
    shadow, windows = np.full((20, 20), 9.0, np.float32), np.empty((2, 4), np.int32)
    triangle = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]], np.float32)
    both = np.concatenate([triangle + np.float32([50.0, 0, 0]), triangle - np.float32([0.0, 50, 0])])
    kernels.cast_shadows(both, np.eye(3), np.zeros(2), 0.1, windows, shadow)
    assert np.all(shadow == 9.0)
    kernels.erase_shadows(windows, shadow.copy(), shadow)


def test_boxes_are_marked_and_cut_at_the_edge():
    grid = np.ones((5, 6), np.uint8)
    kernels.mark(np.array([[1, 1, 2, 2], [4, 3, 9, 9]]), grid)
    assert grid.sum() == 30 - 4 - 4
    assert grid[2, 1] == grid[4, 5] == 0
