"""What makes an alignment a result, cause by cause."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.judgement import classify, correlated_pixels
from sphere_nav.photometric.align.problem import AlignmentState, Descent, Problem
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.params import PyramidParams
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)


def judged(room, params=None, motion=0.0, overlap=1.0, noise=0.0):
    params = params or RegistrationParams()
    image, range_m = room.render(CAMERA, T_BODY_OPTICAL)
    view = View(prepare_reference(image, range_m, CAMERA, params), T_BODY_OPTICAL)
    seen = image + np.random.default_rng(3).normal(size=image.shape).astype(np.float32) * np.float32(noise)
    image = RigImage(build_pyramid(seen, CAMERA, params.pyramid), views=(view,))
    problem = Problem.choose_pixels([image], 0, T_BODY_OPTICAL, params)
    state = AlignmentState.start(T_BODY_OPTICAL, 1)
    descent = Descent(state, 5, motion, True, problem.compare(state)[2])
    return classify(descent, 5, overlap, params, np.zeros((6, 6)))


def test_a_good_end_is_good_and_its_correlation_that_of_the_pixels(room):
    found = judged(room, noise=2.0)
    assert found.is_converged
    assert found.ncc > 0.98
    assert found.mad == pytest.approx(0.6745 * 2.0, rel=0.1)  # of normal noise
    assert np.all(np.linalg.eigvalsh(found.covariance) > 0)
    # of noise and image: ncc^2 is the share of the variance that the image explains
    found = judged(room, noise=20.0)
    variance = float(np.var(room.render(CAMERA, T_BODY_OPTICAL)[0]))
    assert found.ncc == pytest.approx(np.sqrt(variance / (variance + 20.0**2)), abs=0.02)


def test_every_cause_has_its_name_and_an_increment_of_25_smallest_ones_is_no_convergence(room):
    for reason, arguments in [
        ("LOW_OVERLAP", {"overlap": 0.05}),
        ("NO_CONVERGENCE", {"motion": 3.0}),
        ("OUTLIERS", {"noise": 80.0}),
        ("LOW_TEXTURE", {"params": RegistrationParams(max_condition=1.5)}),
        ("LOW_OVERLAP", {"params": RegistrationParams(min_pixels=10**6)}),
    ]:
        found = judged(room, **arguments)
        assert found.reason == reason
        assert not found.is_converged
    for share, reason in [(0.99, ""), (1.01, "NO_CONVERGENCE")]:
        params = RegistrationParams(min_step=0.03)
        assert judged(room, params, motion=share * 25.0 * params.min_step).reason == reason


WIDE = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
# Turned about the view: pixels are met between the others, where interpolation takes no side.
TURNED = SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.1])
ONE_LEVEL = RegistrationParams(pyramid=PyramidParams(num_levels=1))


def measured(room, noise, meters=0.0) -> float:
    """The measured correlation so far off the true pose, with noise (H, W) added to the current image."""
    gray, range_m = room.render(WIDE, SE3.identity())
    now, _ = room.render(WIDE, TURNED)
    pyramid = build_pyramid((now + noise).astype(np.float32), WIDE, ONE_LEVEL.pyramid)
    view = View(prepare_reference(gray, range_m, WIDE, ONE_LEVEL), SE3.identity())
    problem = Problem.choose_pixels([RigImage(pyramid, views=(view,))], 0, TURNED, ONE_LEVEL)
    return correlated_pixels(
        problem.compare(AlignmentState.start(TURNED @ SE3.exp([meters, 0, 0, 0, 0, 0]), 1))[2], 99.0
    )


@pytest.mark.slow
def test_smooth_noise_counts_the_pixels_that_err_together(room, rng):
    sigma_px = 2.0
    smooth = [cv2.GaussianBlur(rng.normal(0, 1.0, (240, 320)), (0, 0), sigma_px) for _ in range(8)]
    found = np.mean([measured(room, 3.0 * noise / noise.std()) for noise in smooth])
    together = 4.0 * np.pi * sigma_px**2  # integral of the autocorrelation of a Gaussian blur
    # The Jacobian's own waves are as short as the blur is wide, so that less of the correlation adds up.
    assert together / 8.0 < found < 2.0 * together


def test_pixels_err_together_no_more_where_the_last_increment_is_still_to_come(room, rng):
    noise = rng.normal(0.0, 3.0, (240, 320))
    assert measured(room, noise, 7e-4) < 1.4 * measured(room, noise)


def test_the_covariance_grows_with_the_correlation(room, rng):
    gray, range_m = room.render(WIDE, SE3.identity())
    views = [View(prepare_reference(gray, range_m, WIDE), SE3.identity())]
    sigmas = []
    for blur in (0.01, 3.0):
        noise = cv2.GaussianBlur(rng.normal(0, 1.0, (240, 320)), (0, 0), blur)
        image = (gray + 3.0 * noise / noise.std()).astype(np.float32)
        sigmas.append(np.trace(register(build_pyramid(image, WIDE), views, SE3.identity()).covariance) ** 0.5)
    assert sigmas[1] > 2.0 * sigmas[0]
