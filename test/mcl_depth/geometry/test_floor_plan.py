"""A floor plan as triangles: their area, what is cut out, what is no wall."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.floor_plan import read_surfaces, rings_of

HEAD = "kind,complete_room,x0_m,y0_m,x1_m,y1_m,z_bottom_m,z_top_m"
L_SHAPE = [(0, 0), (6, 0), (6, 2), (2, 2), (2, 5), (0, 5)]  # 18 square metres, 22 m around
HEIGHT = 2.5
WALLS, FLOORS = 22 * HEIGHT, 2 * 18


def rooms_of(path):
    walls = [surface for surface in read_surfaces(path) if surface.kind == "wall"]
    return {room: rings_of([one for one in walls if one.room == room]) for room in dict.fromkeys(w.room for w in walls)}


def ring_of(corners):
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return [f"wall,a,{x0},{y0},{x1},{y1},0.0,{HEIGHT}" for (x0, y0), (x1, y1) in pairs]


def area_of(tmp_path, rows):
    (tmp_path / "plan.csv").write_text("\n".join([HEAD, *rows]) + "\n")
    mesh = read_geometry(tmp_path / "plan.csv")
    a, b, c = mesh.points[mesh.triangles].astype(float).transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("corners", [L_SHAPE, L_SHAPE[::-1]])
def test_walls_floor_and_ceiling_of_an_l_are_covered_once(tmp_path, corners):
    assert area_of(tmp_path, ring_of(corners)) == pytest.approx(WALLS + FLOORS)


def test_doors_and_openings_are_cut_out_of_their_own_wall(tmp_path):
    for row, cut in [
        ("door,a,6,0.5,6,1.5,0,2", 2.0),
        ("opening,a,1,0,4,0,0.5,1.5", 3.0),
        ("window,a,1,0,4,0,0.5,1.5", 0.0),
        ("door,a,6.14,0.5,6.14,1.5,0,2", 2.0),
        ("door,a,6.16,0.5,6.16,1.5,0,2", 0.0),
        ("door,a,6,0.5,6,1.5,0.06,2", 1.94),
        ("door,b,6,0.5,6,1.5,0,2", 0.0),
    ]:
        assert area_of(tmp_path, [*ring_of(L_SHAPE), row]) == pytest.approx(WALLS + FLOORS - cut)


def test_a_plan_that_is_turned_has_the_same_doors(tmp_path):
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    (x0, y0), (x1, y1) = np.array([[6.0, 0.5], [6.0, 1.5]]) @ turn.T
    corners = [tuple(corner) for corner in L_SHAPE @ turn.T]
    rows = [*ring_of(corners), f"door,a,{x0},{y0},{x1},{y1},0,2"]
    assert area_of(tmp_path, rows) == pytest.approx(WALLS + FLOORS - 2.0)


@pytest.mark.parametrize(("gap", "is_closed"), [(0.019, True), (0.021, False)])
def test_corners_within_two_centimeters_are_one(tmp_path, gap, is_closed):
    rows = ring_of(L_SHAPE)
    words = rows[5].split(",")
    words[4] = str(float(words[4]) - gap)
    rows[5] = ",".join(words)
    (tmp_path / "plan.csv").write_text("\n".join([HEAD, *rows]) + "\n")
    rings = rooms_of(tmp_path / "plan.csv")["a"]
    assert len(rings) == is_closed
    assert (area_of(tmp_path, rows) > WALLS + FLOORS - 1.0) == is_closed
