"""Depth images by position: which are made, how often, and what the comparison answers."""

import numpy as np
import pytest

from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.likeness.depth_map import Comparison, DepthMap
from mcl_depth.likeness.features import visual_features
from mcl_depth.params import CacheParams, FilterParams, SynthesisParams

CAMERA = panorama_window(SynthesisParams(num_columns=72))


class Synthesizer:
    """Random ranges that depend on the place, and a note of what was asked."""

    camera = CAMERA

    def __init__(self):
        self.asked = []

    def synthesize_many(self, positions):
        self.asked.append(np.array(positions))
        seeds = [abs(hash(tuple(np.round(place * 1000).astype(int).tolist()))) for place in positions]
        size = (CAMERA.height, CAMERA.width)
        return np.stack([np.random.default_rng(seed).uniform(1, 9, size) for seed in seeds]).astype(np.float32)


def ground(positions):
    return np.where(positions[:, 0] < 5.0, 0.3, np.nan)


def made(**cache):
    synthesizer = Synthesizer()
    return synthesizer, DepthMap(synthesizer, ground, 1.2, FilterParams(cache=CacheParams(**cache)), "rooms")


@pytest.fixture
def visual():
    gray = np.random.default_rng(7).uniform(0, 255, (CAMERA.height, CAMERA.width)).astype(np.float32)
    return visual_features(gray)


def test_a_position_is_at_most_max_distance_from_its_depth_image():
    synthesizer, depth_map = made(max_distance=0.25)
    places = np.random.default_rng(1).uniform(-4, 4, (200, 2))
    depth_map.fill(places)
    middles = np.concatenate(synthesizer.asked)
    apart = np.linalg.norm(middles[:, None, :2] - places, axis=2)
    assert apart.min(axis=0).max() <= 0.25
    np.testing.assert_allclose(middles[:, 2], 1.5)
    assert depth_map.ranges_from(np.array([9.0, 0.0, 0.0])) is None


def test_what_was_made_once_comes_back_from_disk_and_is_refused_if_it_is_damaged(tmp_path, visual):
    places = np.random.default_rng(2).uniform(-2, 2, (30, 2))
    curves = []
    for _ in range(2):
        synthesizer, depth_map = made(folder=str(tmp_path))
        depth_map.fill(places)
        curves.append(Comparison(visual, depth_map).survey(places))
    assert synthesizer.asked == []
    np.testing.assert_array_equal(curves[0], curves[1])
    for part in tmp_path.glob("*/codes.npy"):
        part.write_bytes(b"nothing")
    with pytest.raises(ValueError, match="expected a cache of depth features"):
        made(folder=str(tmp_path))


def test_features_come_back_from_disk_only_for_the_same_settings(tmp_path, visual):
    (_, first), middle = made(folder=str(tmp_path)), np.array([[0, 0]])
    first.fill(np.array([[0.1, 0.1]]))
    expected = first.similarities(visual, middle)
    synthesizer, again = made(folder=str(tmp_path))
    np.testing.assert_array_equal(again.similarities(visual, middle), expected)
    assert synthesizer.asked == []
    other, differs = made(folder=str(tmp_path), max_distance=0.5)
    differs.similarities(visual, middle)
    assert len(other.asked) == 1


def test_a_place_is_compared_once_and_the_answers_do_not_depend_on_it(visual):
    _, depth_map = made()
    places = np.random.default_rng(3).uniform(-0.5, 0.5, (60, 2))
    wanted = depth_map.similarities(visual, depth_map.cells(places))
    compared: list[int] = []

    def similarities(visual, cells):
        compared.append(len(cells))
        return DepthMap.similarities(depth_map, visual, cells)

    depth_map.similarities = similarities
    np.testing.assert_array_equal(Comparison(visual, depth_map).curves(places), wanted)
    assert compared == [len(np.unique(depth_map.cells(places), axis=0))]
