"""At which level an alignment begins, and that it begins there only for a prediction that may be relied on."""

from dataclasses import replace

import numpy as np

from dense_localizer.constants import CONTRAST_COVARIANCE
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, References
from dense_localizer.track.align import align_rig, find_first_level
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.rig import RigImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES)


def test_the_first_level_is_that_at_which_the_uncertainty_is_a_pixel(room):
    """110 pixels per radian, the scene at 2 m; position and attitude add up."""
    for sigma_m, sigma_rad, level in [(0.0, 1.1 / 110, 1), (0.0, 3.9 / 110, 2), (2.2 / 110, 3.1 / 110, 3)]:
        prediction = Prediction(SE3.identity(), np.diag([sigma_m**2, 0, 0, 0, 0, sigma_rad**2]), 0)
        choice = Choice((0,), (), 1.0, 0.0, typical_range_m=2.0, region_m=2.0)
        assert find_first_level(prediction, choice, build_pyramid(room.photograph(PINHOLE, at(0.0)), PINHOLE)) == level


def test_by_local_contrast_an_alignment_is_less_sure(room, room_map):
    pose, references = at(0.1, 0.0, 0.3), References(room_map, PARAMS)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.registration.pyramid))
    prediction = replace(Prediction.guess(pose), by_contrast=True)
    chosen = references.choose_rig([image], prediction)
    found = align_rig(chosen, prediction, PARAMS)
    alone = register_rig(chosen.covered, pose, PARAMS.registration)
    assert found.T_world_camera.distance(pose) < (0.015, 0.008)
    np.testing.assert_allclose(found.covariance, CONTRAST_COVARIANCE * alone.covariance)
    references.close()


def test_a_sure_prediction_saves_levels_and_a_fallback_or_a_guess_takes_all(room, room_map):
    pose = at(0.1, 0.0, 0.3)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.registration.pyramid))
    sure = Prediction(pose @ SE3.exp([0.003, 0, 0, 0, 0.002, 0]), 1e-8 * np.eye(6), 0)
    references, iterations = References(room_map, PARAMS), []
    for prediction in (sure, replace(sure, defies_odometry=True), Prediction.guess(sure.T_map_camera)):
        found = align_rig(references.choose_rig([image], prediction), prediction, PARAMS)
        assert found.T_world_camera.distance(pose) < (0.015, 0.008)
        iterations.append(found.iterations)
    assert iterations[0] < iterations[1] == iterations[2]
    references.close()
