import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.judgement import correlated_pixels
from sphere_nav.photometric.align.problem import AlignmentState, Problem
from sphere_nav.photometric.params import PyramidParams

CAMERA = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
# Turned about the view: pixels are met between the others, where interpolation takes no side.
TURNED = SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.1])
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=1), illumination=False)


def measured(room, noise) -> float:
    """The measured correlation at the true pose, with noise (H, W) added to the current image."""
    gray, range_m = room.render(CAMERA, SE3.identity())
    now, _ = room.render(CAMERA, TURNED)
    pyramid = build_pyramid((now + noise).astype(np.float32), CAMERA, PARAMS.pyramid)
    views = [View(prepare_reference(gray, range_m, CAMERA, PARAMS), SE3.identity())]
    problem = Problem.choose_pixels(pyramid.levels[0], views, TURNED, PARAMS)
    return correlated_pixels(problem.compare(AlignmentState.start(TURNED, 1)), 99.0)


@pytest.mark.slow
def test_independent_noise_is_correlated_by_interpolation_alone(room, rng):
    found = [measured(room, rng.normal(0, 3.0, (240, 320))) for _ in range(8)]
    # Linear interpolation leaves 2/3 of the variance on average, along each axis, and the sum as it was: (3/2)^2.
    assert np.mean(found) == pytest.approx(2.25, rel=0.35)  # 8 directions x 8 images, two standard deviations


@pytest.mark.slow
@pytest.mark.parametrize("sigma_px", [2.0])
def test_smooth_noise_counts_the_pixels_that_err_together(room, rng, sigma_px):
    smooth = [cv2.GaussianBlur(rng.normal(0, 1.0, (240, 320)), (0, 0), sigma_px) for _ in range(8)]
    found = np.mean([measured(room, 3.0 * noise / noise.std()) for noise in smooth])
    together = 4.0 * np.pi * sigma_px**2  # integral of the autocorrelation of a Gaussian blur
    # The Jacobian's own waves are as short as the blur is wide, so that less of the correlation adds up.
    assert together / 8.0 < found < 2.0 * together


def test_the_covariance_grows_with_the_correlation(room, rng):
    gray, range_m = room.render(CAMERA, SE3.identity())
    views = [View(prepare_reference(gray, range_m, CAMERA), SE3.identity())]
    sigmas = []
    for blur in (0.01, 3.0):
        noise = cv2.GaussianBlur(rng.normal(0, 1.0, (240, 320)), (0, 0), blur)
        image = (gray + 3.0 * noise / noise.std()).astype(np.float32)
        sigmas.append(np.trace(register(build_pyramid(image, CAMERA), views, SE3.identity()).covariance) ** 0.5)
    assert sigmas[1] > 2.0 * sigmas[0]
