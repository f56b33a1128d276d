"""Which likeness the parameters ask for, what it refuses, and a drive that the learned one places from nowhere."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from mcl_depth.belief.estimate import Observation
from mcl_depth.likeness.kinds import check_headings
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.localization.status import State
from sphere_nav.params import build
from worlds.lit_room import POSES, picture, room

PANORAMA = Spherical(512, 256)
SETTINGS = {"camera_height": 1.2, "resampling.num_particles": 400, "input.min_way": 0.05}


@pytest.fixture(scope="module")
def site():
    return Site(room(), PANORAMA, 1.2, build(FilterParams, SETTINGS))


def observe(site, pose, number):
    image, camera = picture(site, pose), site.depth_map.camera
    return Observation(image, camera, (number + 1) * 10**9, np.eye(3), np.array(pose))


def test_a_heading_is_a_whole_number_of_columns():
    for columns, is_fine in [(72, True), (54, False)]:
        refusal = pytest.raises(ValueError, match=r"a multiple of a column, 6\.66667 deg, found 10 deg")
        with nullcontext() if is_fine else refusal:
            check_headings(build(FilterParams, {"heading_step_deg": 10.0, "synthesis.num_columns": columns}))


def test_what_was_learned_reaches_more_by_chance(site):
    edges = Site(room(), PANORAMA, 1.2, build(FilterParams, SETTINGS | {"likeness.kind": "gradients"}), is_ready=False)
    assert [one.filter().evidence._chance_scale for one in (site, edges)] == [2.9, 2.4]


def test_a_place_is_recovered_from_nowhere(site):
    filter_ = site.filter()
    for number, pose in enumerate(POSES):
        belief = filter_.update(observe(site, pose, number)).belief
    best = belief.places[0].pose
    assert np.hypot(*(best[:2] - POSES[-1][:2])) < 0.5  # cells are 0.35 m wide
    assert abs(best[2] - POSES[-1][2]) < np.radians(11)  # a step of headings, and a little


def test_a_start_that_is_given_is_confirmed_and_a_wrong_one_is_not(site):
    for offset, is_right in (([0.1, -0.1, 0.05], True), ([2.6, 2.0, 2.5], False)):
        filter_ = site.filter()
        filter_.start(SE3.from_planar(*(POSES[0] + offset)), np.diag([0.2, 0.2, 0.1, 0.1, 0.1, 0.1]) ** 2)
        states, errors = [], []
        for number, pose in enumerate(POSES):
            estimate = filter_.update(observe(site, pose, number))
            states.append(estimate.status.state)
            if estimate.T_map_level is not None:
                errors.append(np.hypot(*(estimate.T_map_level.translation[:2] - pose[:2])))
        assert (State.TRACKING in states) or not is_right
        assert max(errors, default=0.0) < 0.6
