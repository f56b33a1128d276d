"""What stands in a street is whole: it stands on the ground, nothing of it floats, sides look out."""

import numpy as np

from cycab_sim.world import finishes, furniture
from cycab_sim.world.mesh import placed
from cycab_sim.world.texture import kernels as k
from worlds.parts import Recorder, floating

KINDS = ("car", "lamp", "traffic_sign", "bollard", "box", "bench", "monument", "kiosk")
GAPS = {"box": 0.06, "bench": 0.1}  # m: a cabinet on low feet, a back above its seat; the rest is one piece


def built(kind, seed):
    mesh = Recorder(np.random.default_rng(seed))
    getattr(furniture, f"add_{kind}")(mesh, placed(0.0, 0.0, 0.0), np.random.default_rng(seed))
    return mesh


def test_a_thing_is_whole():
    for kind in KINDS:
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
