"""Photographs in bare geometry: a home in its floor plan, six cameras of a car in one sweep of its LiDAR."""

from __future__ import annotations

from argparse import Namespace

import numpy as np
import pytest

from benchmarks.mcl_panoramas import read_shots
from benchmarks.mcl_surround import run
from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import depth_features_many, heading, similarity_many, visual_features
from mcl_depth.params import ComparisonParams, SynthesisParams


@pytest.fixture(scope="module")
def errors(shared_data):
    """Errors of the visual compass in degrees at the true places, every degree and every ten."""
    folder, params = shared_data / "panoramas_in_floor_plan", ComparisonParams()
    synthesizer = DepthSynthesizer(read_geometry(folder / "surfaces.csv"), SynthesisParams(num_columns=360))
    shots = read_shots(folder, synthesizer.camera)
    there = depth_features_many(synthesizer.synthesize_many(np.stack([shot.place for shot in shots])), params)
    found = {}
    for count in (360, 36):
        off = [
            heading(similarity_many(visual_features(shot.gray), there, count, np.array([i]))[0]).yaw - shot.yaw
            for i, shot in enumerate(shots)
        ]
        found[count] = np.abs(np.degrees(np.angle(np.exp(1j * np.array(off)))))
    return found


def test_the_compass_finds_the_heading_of_photographs(errors) -> None:
    """The figures of an independent implementation on the whole set."""
    assert np.mean(errors[360] <= 10.0) >= 0.85
    assert np.mean(errors[360] <= 5.0) >= 0.80
    assert np.median(errors[360]) <= 2.0


def test_ten_degrees_are_fine_enough_for_the_filter(errors) -> None:
    assert np.mean(errors[36] <= 10.0) >= 0.80


@pytest.mark.slow
def test_six_photographs_find_their_place_in_a_sweep_and_mirrored_ones_do_not(shared_data) -> None:
    report = run(Namespace(surround=shared_data / "surround" / "nuscenes", threads=1))
    assert len(report.bounds) == 3
    assert {bound.what: bound.measured for bound in report.bounds if not bound.is_met} == {}
