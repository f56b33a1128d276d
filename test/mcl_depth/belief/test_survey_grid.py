"""Cells of a map: which are compared, which lie around a pose, where a cell is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mcl_depth.belief.survey_grid import SurveyGrid

EDGE = 0.5


def depth_map(capacity=10**6):
    def cells(places):
        return np.floor(np.asarray(places) / EDGE).astype(np.int64)

    return SimpleNamespace(edge=EDGE, cells=cells, cache=SimpleNamespace(capacity=capacity))


def l_shape():
    """Middles of cells of an L around the origin: 12 x 4 and 3 x 8 cells."""
    cells = {(x, y) for x in range(-4, 8) for y in range(-3, 1)} | {(x, y) for x in range(-4, -1) for y in range(8)}
    return (np.array(sorted(cells)) + 0.5) * EDGE


def test_rows_around_a_pose_are_those_of_a_search():
    reach = 3
    for pose in [(0.3, -0.2, 1.0), (-1.9, 3.4, 0.0), (-9.0, 0.0, 0.0)]:
        grid = SurveyGrid(depth_map(), l_shape())
        rows = grid.rows_around(np.array(pose), reach)
        middle = np.floor(np.array(pose[:2]) / EDGE)
        for i in range(2 * reach + 1):
            for j in range(2 * reach + 1):
                place = (middle + np.array([i - reach, j - reach]) + 0.5) * EDGE
                there = np.flatnonzero(np.all(np.abs(grid.positions - place) < 1e-9, axis=1))
                assert rows[i, j] == (there[0] if len(there) else -1)


def test_no_more_cells_than_four_fifths_of_the_cache():
    for spare, is_coarser in [(0, False), (-1, True), (-60, True)]:
        middles = l_shape()
        capacity = int(np.ceil(len(middles) / 0.8)) + spare
        grid = SurveyGrid(depth_map(capacity), middles)
        assert (grid.edge > EDGE) == is_coarser
        assert len(grid.positions) <= 0.8 * capacity
        off = np.min(np.linalg.norm(middles[None] - grid.positions[:, None], axis=2), axis=1)
        assert off.max() < 1e-9  # what is compared is a cell of the map
        assert grid.diagonal == pytest.approx(np.sqrt(2) * EDGE)
