"""A view of which a part has changed: the parts that have not are found, they hold the pose, a wrong place has none."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import Aspect, find_rig_structure, find_support
from sphere_nav.photometric.constants import MIN_VIEW_PIXELS
from sphere_nav.photometric.parts.registration import Votes, vote
from sphere_nav.photometric.pixels.samples import sample_images
from worlds.parked import CAMERA, SPHERE, TRUTH, other_day, parked
from worlds.room import optical, views_of

PARAMS = RegistrationParams(max_pixels=20_000, max_mad=100.0)
PLACES = [SE3.from_planar(-2.0, 0.0, 0.0), SE3.from_planar(-1.2, 0.0, 0.0)]


@pytest.fixture(scope="module")
def views():
    return views_of(parked(), PARAMS, SPHERE, PLACES)


class Looked:
    """An image with the map, aligned from a guess, and what its cells say."""

    def __init__(self, room, views):
        image = room.photograph(CAMERA, TRUTH, 1)
        self.images = [RigImage(build_pyramid(image, CAMERA, PARAMS.pyramid), views=tuple(views))]
        self.found = register(self.images[0].pyramid, views, TRUTH, PARAMS)

    def vote(self, T_world_camera) -> Votes:
        sample = sample_images(self.images, T_world_camera, self.found.light, PARAMS)
        return vote(self.images, PARAMS, sample.of_views(MIN_VIEW_PIXELS))

    def support(self, T_world_camera, T_predicted=None):
        return find_support(self.vote, T_world_camera, T_predicted)


@pytest.fixture(scope="module")
def look(views):
    return Looked(other_day(), views)


def off(pose):
    return float(pose.distance(TRUTH)[0])


def test_parts_that_have_not_changed_correct_the_pose_and_know_how_well(look):
    pose = look.found.T_world_camera
    assert off(pose) > 0.005  # or nothing has pulled it
    support = look.support(pose)
    assert support.is_proven
    assert 0.5 < support.num_agreeing / support.num_cells < 0.8
    assert off(pose @ SE3.exp(support.xi)) < 0.4 * off(pose)
    xi = (TRUTH.inverse() @ look.found.T_world_camera @ SE3.exp(support.xi)).log()
    assert xi @ np.linalg.solve(support.covariance, xi) < 22.5  # chi^2 of 6 at 0.001
    assert np.sqrt(np.linalg.eigvalsh(support.covariance[:3, :3])[-1]) < 0.01
    everything = replace(look.found, T_world_camera=TRUTH).covariance
    assert np.all(np.diagonal(support.covariance) < 100.0 * np.diagonal(everything))


@pytest.mark.parametrize("guess", [(-1.7, 0.1, -1.6), (0.5, 0.5, 0.3)])
def test_a_wrong_place_has_no_support(look, guess):
    wrong = register(look.images[0].pyramid, look.images[0].views, optical(SE3.from_planar(*guess)), PARAMS)
    assert off(wrong.T_world_camera) > 0.3
    support = look.support(wrong.T_world_camera)
    assert support.chance > 1e-2
    assert not support.xi.any()


def test_a_prediction_is_asked_where_the_alignment_was_drawn_away(look):
    away, predicted = TRUTH @ SE3.exp([0.0, 0.0, 0.3, 0.0, 0.05, 0.0]), TRUTH @ SE3.exp([0.01, 0, 0.02, 0, 0, 0])
    assert not look.support(away).is_proven
    support = look.support(away, predicted)
    assert support.is_proven
    assert off(away @ SE3.exp(support.xi)) < 0.005
    assert not look.support(away, away @ SE3.exp([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])).is_proven


def test_a_cell_agrees_within_one_pixel(views):
    same = Looked(parked(), views)
    turned = [same.support(TRUTH @ SE3.exp([0, 0, 0, 0, px / CAMERA.fx, 0])) for px in (0.0, 0.9, 2.5)]
    shares = [one.num_agreeing / one.num_cells for one in turned]
    assert shares[0] > 0.9
    # what agrees a little off is followed, what is off by more is not
    assert turned[1].is_proven
    assert turned[1].xi[4] == pytest.approx(-0.9 / CAMERA.fx, abs=0.1 / CAMERA.fx)
    assert not turned[2].is_proven


def test_the_parts_are_asked_only_where_the_whole_agrees_little(look, views):
    low = find_rig_structure(look.images, replace(look.found, ncc=0.66), PARAMS, None, Aspect.FIT)
    assert low.agreement > 0.3
    assert not low.support.num_cells
    unlike = find_rig_structure(look.images, replace(look.found, ncc=0.64), PARAMS, None, Aspect.FIT)
    assert unlike.support.is_proven
    wrong = replace(look.found, T_world_camera=TRUTH @ SE3.exp([0.0, 0.0, 0.3, 0.0, 0.05, 0.0]))
    asked = find_rig_structure(look.images, wrong, PARAMS, None, Aspect.FIT, TRUTH)
    assert asked.agreement < 0.3
    assert asked.support.is_proven
    np.testing.assert_allclose((wrong.T_world_camera @ SE3.exp(asked.support.xi)).log(), TRUTH.log(), atol=0.005)
