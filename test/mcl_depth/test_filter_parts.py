"""The cache of depth images, homing, presets and what is compiled before the first image."""

import numpy as np
import pytest

from mcl_depth.geometry import kernels as geometry
from mcl_depth.homing import Homing, sample_offsets, waypoints_of
from mcl_depth.likeness import kernels as likeness
from mcl_depth.likeness.depth_cache import DepthCache
from mcl_depth.params import DirectionParams, FilterParams
from mcl_depth.site import PRESETS, apply_preset
from mcl_depth.warm_up import warm_up
from sphere_nav.geometry import Pinhole, Spherical
from sphere_nav.params import build, to_mapping


def features(value, count=1):
    """Features of so many panoramas, all of one value: 36 bytes each."""
    return {"scale": np.full(count, value, np.float32), "magnitudes": np.full((count, 4, 8), value, np.uint8)}


def cache_of(num_panoramas):
    return DepthCache(num_panoramas * 36, features(0))


def test_the_cache_gives_away_what_was_not_used_for_longest_and_survives_on_disk(tmp_path):
    cache = cache_of(3)
    for number in range(3):
        cache.insert([(number, 0)], features(number))
    cache.find([(0, 0)])
    cache.insert([(9, 9)], features(9))
    assert (1, 0) not in cache
    assert cache.stack["scale"][cache.find([(0, 0)])[0]] == 0.0
    cache.save(tmp_path / "kept")
    again = cache_of(3)
    again.load(tmp_path / "kept")
    assert len(again) == 3
    assert again.stack["scale"][again.find([(9, 9)])[0]] == 9.0


def test_the_last_to_write_wins_and_leaves_nothing_beside(tmp_path):
    for value in (1, 2):
        cache = cache_of(3)
        cache.insert([(value, 0)], features(value))
        cache.save(tmp_path / "kept" / "a")
    cache = cache_of(3)
    cache.load(tmp_path / "kept" / "a")
    assert cache.find([(1, 0), (2, 0)]).tolist() == [-1, 0]
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["a"]


def test_homing_samples_are_those_of_the_paper():
    ring = sample_offsets(1.0)
    assert ring.shape == (33, 2)  # 16 directions at 1 m and 2 m, and the waypoint itself
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), [0.0] + [1.0] * 16 + [2.0] * 16)


def test_a_direction_is_clear_where_the_best_samples_lead_by_one_and_a_half_deviations():
    """Of 33 samples `num_best` fit equally well, the others not at all: a lead of sqrt((1 - p) / p), p their share."""
    for num_best, lead, is_clear in [(10, 1.517, True), (11, 1.414, False)]:
        like = np.zeros((33, 8), np.float32)
        like[:num_best, 3] = 1.0
        advice = Homing(np.array([[0.0, 0.0], [9.0, 0.0]]), DirectionParams()).update(Curves(like))
        assert advice.lead == pytest.approx(lead, abs=1e-3)
        assert advice.is_clear == is_clear


class Curves:
    def __init__(self, values):
        self.values = values

    def curves(self, positions):
        assert len(positions) == len(self.values)
        return self.values


def test_waypoints_are_evenly_spaced():
    points = waypoints_of(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]), 1.5)
    np.testing.assert_allclose(points, [[0, 0], [1.5, 0], [3, 0], [3, 1.5], [3, 3]])


@pytest.mark.parametrize("name", ["cells", "scale"])
def test_a_cache_of_another_size_or_kind_is_refused(tmp_path, name):
    cache = cache_of(3)
    cache.insert([(1, 2), (3, 4)], features(1, 2))
    cache.save(tmp_path / "kept")
    found = np.load(tmp_path / "kept" / f"{name}.npy")
    np.save(tmp_path / "kept" / f"{name}.npy", found[:1])
    with pytest.raises(ValueError, match=r"kept: scale: expected"):
        cache_of(1000).load(tmp_path / "kept")
    np.save(tmp_path / "kept" / "cells.npy", np.zeros((2, 2), np.int64))
    np.save(tmp_path / "kept" / "scale.npy", np.zeros(2, np.float32))
    np.save(tmp_path / "kept" / "magnitudes.npy", np.zeros((2, 4, 7), np.uint8))
    with pytest.raises(ValueError, match=r"kept: magnitudes: expected \(2, 4, 8\) of uint8, found \(2, 4, 7\)"):
        cache_of(1000).load(tmp_path / "kept")


def test_a_smaller_cache_takes_what_was_used_last(tmp_path):
    cache = cache_of(4)
    for number in range(4):
        cache.insert([(number, -number)], features(number))
    cache.find([(0, 0)])
    cache.save(tmp_path / "kept")
    small = DepthCache(2 * 36 + 5, features(0))
    small.load(tmp_path / "kept")
    assert len(small) == 2
    slots = small.find([(3, -3), (0, 0), (2, -2), (1, -1)])
    assert (slots >= 0).tolist() == [True, True, False, False]
    assert small.stack["scale"][slots[:2]].tolist() == [3.0, 0.0]
    assert DepthCache(1, features(0)).capacity == 1
    small.load(tmp_path / "none")
    assert len(small) == 2


ROOM = (np.zeros(3), np.array([9.0, 6.0, 2.6]))
CORRIDOR = (np.zeros(3), np.array([160.0, 5.0, 2.6]))
TOWN = (np.zeros(3), np.array([140.0, 120.0, 20.0]))


def test_the_cloud_tells_the_surroundings():
    for box, name in [(ROOM, "indoor"), (CORRIDOR, "indoor"), (TOWN, "outdoor")]:
        found = apply_preset(FilterParams(), box, PANORAMA)
        assert found.preset == name
        values = to_mapping(found)
        assert {key: values[key] for key in PRESETS[name]} == PRESETS[name]


def test_what_was_set_stays_and_what_was_chosen_is_used():
    given = build(FilterParams, {"preset": "outdoor", "area.step": 1.0})
    found = apply_preset(given, ROOM, PANORAMA)
    assert (found.area.step, found.cache.max_distance) == (1.0, 0.5)


PANORAMA, WEB = Spherical(512, 256), Pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


@pytest.mark.parametrize(
    ("camera", "box", "settings", "kind"),
    [
        (PANORAMA, ROOM, {}, "learned"),
        (PANORAMA, TOWN, {}, "gradients"),
        (WEB, ROOM, {}, "gradients"),
        (Spherical(360, 96, 360.0, 0.0, 42.0), ROOM, {}, "learned"),
        (Spherical(360, 60, 360.0, 0.0, 60.0), ROOM, {}, "gradients"),  # it does not show enough
        (PANORAMA, ROOM, {"synthesis.num_columns": 360}, "gradients"),  # which the networks do not know
        (WEB, ROOM, {"likeness.kind": "learned"}, "learned"),
        (PANORAMA, ROOM, {"likeness.kind": "gradients"}, "gradients"),
    ],
)
def test_a_panorama_in_a_building_is_compared_by_what_was_learned(camera, box, settings, kind):
    assert apply_preset(build(FilterParams, settings), box, camera).likeness.kind == kind


KERNELS = (  # that an image, or a panorama that it is compared with, goes through
    likeness.compare_headings_many, likeness.correlate_codes, geometry.draw_many,
)  # fmt: skip


@pytest.mark.slow
def test_every_step_of_headings_can_be_warmed_up():
    warm_up(build(FilterParams, {"heading_step_deg": 10.0}))
    assert [kernel.__name__ for kernel in KERNELS if not kernel.signatures] == []
