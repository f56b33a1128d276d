"""What stands in a street is whole: it stands on the ground, nothing of it floats, sides look out."""

import numpy as np
import pytest

from cycab_sim.world import finishes, furniture
from cycab_sim.world.mesh import placed
from cycab_sim.world.texture import kernels as k
from worlds.parts import Recorder, floating

KINDS = ("car", "lamp", "traffic_sign", "bollard", "box", "bench", "monument", "kiosk")
ASYMMETRIC = {"monument", "kiosk"}  # the rider's horse walks; posters hang all around
GAPS = {"box": 0.06, "bench": 0.1}  # m: a cabinet on low feet, a back above its seat; the rest is one piece
CRATE = finishes.slats((0.36, 0.25, 0.14), 0.13)


def built(kind, seed):
    mesh = Recorder(np.random.default_rng(seed))
    getattr(furniture, f"add_{kind}")(mesh, placed(0.0, 0.0, 0.0), np.random.default_rng(seed))
    return mesh


@pytest.mark.parametrize("kind", KINDS)
def test_a_thing_is_whole(kind):
    for seed in range(8):
        parts = built(kind, seed).parts
        assert 0.0 <= min(part.bounds[0, 2] for part in parts) <= (0.05 if kind == "box" else 1e-9)
        assert floating(parts, GAPS.get(kind, 0.02)) == []
        for part in parts:
            if len(part.quads) > 1:
                assert part.looks_outward()
            if part.finish.kind == k.SIGN:  # its width and height are those of a side of the board
                sides = np.linalg.norm(np.diff(part.quads, axis=1), axis=2)[:, :2]
                assert np.isclose(sides, part.finish.params[1:3], atol=1e-6).all(axis=1).any()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ASYMMETRIC])
def test_a_thing_is_the_same_to_its_left_and_right(kind):
    for seed in range(8):
        parts = built(kind, seed).parts
        if parts[0].finish != CRATE:  # crates lie as they fell
            y = np.sort(np.concatenate([part.points[:, 1] for part in parts]))
            np.testing.assert_allclose(y, -y[::-1], atol=0.011 if kind == "bench" else 1e-9)


def test_a_car_has_the_size_of_one_and_four_wheels_at_its_corners():
    for seed in range(8):
        parts = built("car", seed).parts
        size = np.ptp(np.concatenate([part.bounds for part in parts]), axis=0)
        assert 3.7 <= size[0] <= 4.43
        assert 1.65 <= size[1] <= 1.8
        assert 1.4 <= size[2] <= 1.7
        tires = [part for part in parts if part.finish == finishes.RUBBER]
        places = np.array([part.bounds.mean(axis=0) for part in tires])
        assert len(tires) == 4
        np.testing.assert_allclose([np.ptp(part.bounds, axis=0) for part in tires], [[0.62, 0.2, 0.62]] * 4, atol=1e-9)
        np.testing.assert_allclose(places[:, 2], 0.31, atol=1e-9)
        assert np.abs(places[:, 0]).min() > 0.9  # before and behind the cabin
        assert sorted(np.sign(places[:, :2]).tolist()) == [[-1, -1], [-1, 1], [1, -1], [1, 1]]
        glass = next(part for part in parts if part.finish.kind == k.WINDOW)
        assert glass.bounds[0, 2] == 0.9
        assert abs(glass.bounds.mean(axis=0)[0]) < 0.5


def test_a_lamp_shines_below_its_head():
    for seed in range(4):
        mesh = built("lamp", seed)
        ((x, y, z),) = mesh.lamps
        head = mesh.parts[-1].bounds
        assert [x, y] == pytest.approx(head.mean(axis=0)[:2].tolist())
        assert 0.05 < head[0, 2] - z < 0.1


def test_a_hedge_begins_at_its_place_and_is_as_long_as_asked():
    mesh = Recorder(np.random.default_rng(1))
    furniture.add_hedge(mesh, placed(3.0, 4.0, np.pi / 2), 6.0, np.random.default_rng(1))
    points = mesh.build().triangles.reshape(-1, 3)
    low, high = np.percentile(points, [1, 99], axis=0)
    np.testing.assert_allclose([low, high], [[2.65, 4.0, 0.0], [3.35, 10.0, 1.05]], atol=0.08)


def test_lumps_are_rough_balls_with_leaves_all_over():
    mesh = Recorder(np.random.default_rng(1))
    furniture.add_lump(mesh, np.array([1.0, 2.0, 5.0]), 2.0, finishes.foliage(np.random.default_rng(2)), mesh.rng)
    points = mesh.build().triangles.reshape(-1, 3) - [1.0, 2.0, 5.0]
    away = np.linalg.norm(points / [1.0, 1.0, 0.85], axis=1)
    assert np.percentile(away, 2) > 0.5 * 2.0
    assert np.percentile(away, 98) < 1.3 * 2.0
    assert np.abs(points.mean(axis=0)).max() < 0.25


def test_prisms_are_as_wide_and_high_as_asked_and_stand_on_their_place():
    for is_solid in (False, True):
        mesh = Recorder(np.random.default_rng(1))
        furniture.add_prism(mesh, placed(1.0, 2.0, 0.0, 3.0), 0.5, 2.0, finishes.METAL, is_solid)
        built_mesh = mesh.build()
        points = built_mesh.triangles.reshape(-1, 3).astype(np.float64)
        np.testing.assert_allclose(
            [points.min(axis=0), points.max(axis=0)], [[0.5, 1.5, 3.0], [1.5, 2.5, 5.0]], atol=1e-6
        )
        volume = np.sum(np.linalg.det(built_mesh.triangles.astype(np.float64))) / 6  # closed, and looks outward
        assert volume == pytest.approx(2.0 * 8 * 0.5 * 0.5 * 0.5 * np.sin(np.pi / 4), rel=1e-6)


def test_the_ball_of_a_lump_is_closed_and_round():
    points, faces = furniture._sphere_faces()
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0)
    edges = {(a, b) for face in faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)}
    assert len(edges) == 3 * len(faces)  # each once in each direction
    assert {(b, a) for a, b in edges} == edges
    assert 0.85 < np.sum(np.linalg.det(points[faces])) / 6 / (4 / 3 * np.pi) < 1.0
