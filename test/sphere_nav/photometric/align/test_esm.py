"""A known motion is recovered; what cannot be registered is refused with its reason; what else is told of a result."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, FrameMotion, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, evaluate, prepare_reference, register
from sphere_nav.photometric.align.esm import classify, correlated_pixels
from sphere_nav.photometric.align.problem import AlignmentState, Descent, Problem, RigImage
from sphere_nav.photometric.params import PyramidParams
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

PINHOLE = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
SPHERE = Spherical(512, 256)
AT = SE3.from_planar(0.5, -0.4, 0.3)
CURRENT = {
    "pinhole": (PINHOLE, T_BODY_OPTICAL),
    "distorted": (Pinhole(160, 120, 100.0, 100.0, 79.5, 59.5, (-0.2, 0.03)), T_BODY_OPTICAL),
    "double sphere": (DoubleSphere(160, 160, 50.0, 50.0, 79.5, 79.5, -0.2, 0.55), T_BODY_OPTICAL),
    "fisheye": (Fisheye(160, 160, 50.0, 50.0, 79.5, 79.5, (0.02, -0.01, 0.0, 0.0)), T_BODY_OPTICAL),
    "sphere": (Spherical(256, 128), SE3.identity()),
}


@pytest.fixture(scope="module")
def sphere_view(room):
    image, range_m = room.render(SPHERE, AT)
    return View(prepare_reference(image, range_m, SPHERE), AT)


def error_of(alignment, truth):
    distance, angle = alignment.T_world_camera.distance(truth)
    return float(distance), float(angle)


@pytest.mark.parametrize("kind", CURRENT)
def test_every_camera_is_registered_with_a_sphere(room, sphere_view, kind):
    camera, T_body_camera = CURRENT[kind]
    truth = AT @ SE3.exp([0.15, -0.1, 0.05, 0.02, -0.03, 0.08]) @ T_body_camera
    image, _ = room.render(camera, truth)
    found = register(build_pyramid(image, camera), [sphere_view], AT @ T_body_camera)
    distance, angle = error_of(found, truth)
    assert found.is_converged, found.reason
    assert distance < 0.01  # resampling between a 512 column sphere and a camera of 110 px/rad
    assert angle < 0.003
    assert found.ncc > 0.97
    assert found.overlap > 0.9


def test_what_no_camera_saw_is_not_compared(room, sphere_view):
    """Behind the last column that was seen an image goes on, as if nothing there had moved."""
    camera, T_body_camera = CURRENT["pinhole"]
    truth = AT @ T_body_camera @ SE3.exp([0.05, 0.0, 0.2, 0.0, 0.02, 0.0])
    image, _ = room.render(camera, truth)
    is_seen = np.ones(image.shape, np.bool_)
    is_seen[:, 100:] = False
    image[:, 100:] = image[:, 99:100]
    pyramid = build_pyramid(image, camera, is_seen=is_seen)
    assert all(np.isnan(one[:, -1]).all() and np.isfinite(one[:, 0]).all() for one in pyramid.images)
    told, untold = (register(one, [sphere_view], AT @ T_body_camera) for one in (pyramid, build_pyramid(image, camera)))
    assert told.num_pixels < 0.7 * untold.num_pixels
    assert error_of(told, truth)[0] < 0.001 < 0.25 * error_of(untold, truth)[0]


def test_a_guess_whose_rotation_rounding_has_bent_leads_to_a_rotation(room, sphere_view):
    """Each guess of a long drive is a product with inverses, in which rounding doubles from one to the next."""
    camera, T_body_camera = CURRENT["sphere"]
    guess, image = AT @ T_body_camera, room.render(camera, AT @ T_body_camera)[0]
    bent = SE3(guess.matrix * np.array([1 + 1e-7, 1.0, 1.0, 1.0]))
    R = register(build_pyramid(image, camera), [sphere_view], bent).T_world_camera.rotation
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


def test_a_change_of_light_is_a_gain_and_a_bias(room, sphere_view):
    truth = AT @ SE3.exp([0.1, 0.0, 0.0, 0.0, 0.0, 0.05]) @ T_BODY_OPTICAL
    image, _ = room.render(PINHOLE, truth)
    found = register(build_pyramid(0.6 * image + 20.0, PINHOLE), [sphere_view], AT @ T_BODY_OPTICAL)
    assert error_of(found, truth)[0] < 0.01
    assert found.gains[0] == pytest.approx(1 / 0.6, rel=0.03)
    assert found.biases[0] == pytest.approx(-20 / 0.6, abs=3.0)


def test_a_far_sphere_still_gives_rotation_and_says_that_translation_is_unknown(room):
    image, range_m = room.render(SPHERE, AT)
    far = View(prepare_reference(image, np.full_like(range_m, np.inf), SPHERE), AT)
    truth = AT @ SE3.exp([0, 0, 0, 0.01, -0.02, 0.06]) @ T_BODY_OPTICAL
    current, _ = room.render(PINHOLE, truth)
    found = register(build_pyramid(current, PINHOLE), [far], AT @ T_BODY_OPTICAL)
    deviation = np.sqrt(np.diag(found.covariance))
    distance, angle = error_of(found, truth)
    assert deviation[:3].max() > 0.5
    assert distance < 3.0 * np.linalg.norm(deviation[:3])
    assert angle < 1e-3
    assert deviation[3:].max() < 1e-3


def test_looking_elsewhere_is_low_overlap(room):
    image, range_m = room.render(PINHOLE, AT @ T_BODY_OPTICAL)
    view = View(prepare_reference(image, range_m, PINHOLE), AT @ T_BODY_OPTICAL)
    behind = AT @ SE3.from_planar(0, 0, np.pi) @ T_BODY_OPTICAL
    current, _ = room.render(PINHOLE, behind)
    found = register(build_pyramid(current, PINHOLE), [view], behind)
    assert found.reason == "LOW_OVERLAP"
    assert np.isinf(np.diag(found.covariance)).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_instead_of_an_image_is_refused(sphere_view, seed):
    noise = np.random.default_rng(seed).integers(0, 255, (120, 160)).astype(np.uint8)
    found = register(build_pyramid(noise, PINHOLE), [sphere_view], AT @ T_BODY_OPTICAL)
    assert found.reason in ("OUTLIERS", "NO_CONVERGENCE")
    assert np.isfinite(found.T_world_camera.matrix).all()


def test_evaluating_a_pose_says_what_registering_would_and_moves_nothing(room, sphere_view):
    truth = AT @ SE3.exp([0.1, 0.05, 0.0, 0.0, 0.0, 0.05]) @ T_BODY_OPTICAL
    pyramid = build_pyramid(room.render(PINHOLE, truth)[0], PINHOLE)
    found = register(pyramid, [sphere_view], AT @ T_BODY_OPTICAL)
    same = evaluate(pyramid, [sphere_view], found.T_world_camera)
    off = evaluate(pyramid, [sphere_view], AT @ T_BODY_OPTICAL)
    assert np.allclose(same.T_world_camera.matrix, found.T_world_camera.matrix, rtol=0.0, atol=1e-12)
    assert same.iterations == 0
    assert same.ncc == pytest.approx(found.ncc, abs=0.01)
    assert off.mad > 3.0 * same.mad


ROLLING = Pinhole(320, 240, 262.0, 262.0, 159.5, 119.5)
FINE_SPHERE = Spherical(1024, 512)
READOUT = 0.68  # of the time between two frames
FRAME_TURN = np.radians(1.2)


@pytest.fixture(scope="module")
def fine_view(room):
    image, range_m = room.render(FINE_SPHERE, SE3.identity())
    return View(prepare_reference(image, range_m, FINE_SPHERE), SE3.identity())


def test_the_error_is_that_of_a_global_shutter(room, fine_view):
    rng = np.random.default_rng(0)
    axis, direction = rng.normal(size=(2, 3))
    moved = np.concatenate([0.02 * direction, FRAME_TURN * axis / np.linalg.norm(axis)])
    truth = SE3.exp(0.1 * rng.normal(size=6)) @ T_BODY_OPTICAL
    motion = FrameMotion(truth @ SE3.exp(-moved), READOUT)
    start = truth @ SE3.exp(0.3 * moved)
    images = (room.render(ROLLING, truth)[0], room.render_rolling(ROLLING, truth, READOUT * moved))
    still, rolling = (build_pyramid(image, ROLLING) for image in images)
    found = [register(still, [fine_view], start)]
    found += [register(rolling, [fine_view], start, motion=one) for one in (motion, None)]
    errors = np.array([result.T_world_camera.distance(truth) for result in found])
    assert (errors[1] < 1.3 * errors[0] + (2e-4, 5e-5)).all()  # and what float32 and resampling leave
    assert (errors[2] > 4.0 * errors[1]).all()  # what it costs not to know


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
