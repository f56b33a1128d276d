"""A refined lens is believed where each half of the drive shows it in the other one, and nowhere else."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rig_calibration.drive import proof
from rig_calibration.drive.drive_image import collect
from rig_calibration.drive.drive_lens import MAP, READOUT, Lens
from rig_calibration.drive.proof import lens_distance, prove, speed_in_image
from sphere_nav.estimation.least_squares import weigh
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.rolling_shutter import MAX_READOUT_S
from sphere_nav.photometric import View, build_pyramid, prepare_reference
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import Room

CAMERA = Pinhole(80, 60, 50.0, 50.5, 40.0, 29.0, (-0.1, 0.02, 0.0, 0.0))
OTHER = replace(CAMERA, fx=53.0, fy=53.0)
SPHERE = Spherical(384, 192)
WINDOW = Spherical(192, 96, 384, 96, 48)
READOUT_S, SPEED = 0.03, 0.6


@pytest.fixture(scope="module")
def rooms():
    """The room, and views of it: the whole sphere, and the window of a camera whose focal length is 4 % off."""
    room = Room()
    image, range_m = room.render(SPHERE, SE3.identity())
    whole = View(prepare_reference(image, range_m, SPHERE), SE3.identity())
    stretched = np.diag([1.0, 1.04, 1.04])  # what a lens that is said to be shorter than it is makes of the room

    rays = WINDOW.unproject(np.stack(np.meshgrid(np.arange(192.0), np.arange(96.0)), axis=-1))
    true = rays @ np.linalg.inv(stretched)
    gray, true_range = room.cast(np.zeros(3), true / np.linalg.norm(true, axis=-1, keepdims=True))
    range_m = true_range / np.linalg.norm(true, axis=-1)  # the same distance along the axis
    partial = View(prepare_reference(gray.astype(np.float32), range_m.astype(np.float32), WINDOW), SE3.identity())
    return room, whole, partial


def drive(rooms, view, cameras, given, turn=0.1):
    """Images by one camera after the other, at places that are known to 1 cm and half a degree."""
    rng = np.random.default_rng(5)
    images = []
    for camera in cameras:
        truth = SE3.exp(rng.normal(size=6) * (0.3, 0.3, 0.1, turn, turn, turn)) @ T_BODY_OPTICAL
        velocity = rng.normal(size=6) * SPEED
        gray = rooms[0].render_rolling(camera, truth, READOUT_S * velocity)
        gray += rng.normal(0.0, 2.0, gray.shape)
        pyramid = build_pyramid(np.clip(gray, 0, 255).astype(np.float32), given)
        images.append(collect(pyramid, view, truth @ SE3.exp(0.01 * rng.normal(size=6)), velocity))
    return images


@pytest.fixture(autouse=True)
def few_pixels(monkeypatch):
    monkeypatch.setattr("rig_calibration.drive.drive_image.NUM_LENS_PIXELS", 250)


def off_in_sigmas(judged, truth):
    sigma = np.sqrt(np.diagonal(judged.found.covariance))[:MAP]
    return np.abs(judged.found.lens.values[:MAP] - truth.values) / sigma


@pytest.mark.slow
def test_a_wrong_lens_is_replaced_by_one_that_is_as_unsure_as_its_halves_differ(rooms):
    judged = prove(drive(rooms, rooms[1], [CAMERA] * 6, OTHER), Lens.of(OTHER))
    assert judged.reasons == ()
    assert off_in_sigmas(judged, Lens.of(CAMERA, READOUT_S)).max() < 3.0
    assert judged.found.lens.camera.fx == pytest.approx(CAMERA.fx, rel=0.005)
    off = 0.5 * (judged.halves[0].values - judged.halves[1].values)
    assert off @ np.linalg.solve(judged.found.covariance, off) < 1.0


@pytest.mark.slow
def test_a_right_lens_stays(rooms):
    steps = []
    images = drive(rooms, rooms[1], [CAMERA] * 6, CAMERA)
    judged = prove(images, Lens.of(CAMERA, READOUT_S), progress=lambda: steps.append(1))
    assert len(steps) > 3  # who waits sees that it goes on: all and both halves
    assert any("held-out images" in reason for reason in judged.reasons)


@pytest.mark.slow
def test_halves_of_two_lenses_are_refused(rooms):
    between = replace(CAMERA, fx=51.5, fy=51.5)
    images = drive(rooms, rooms[1], [CAMERA] * 3 + [OTHER] * 3, between)
    judged = prove(images, Lens.of(between, READOUT_S), max_readout=0.02)
    assert any("halves of the drive" in reason for reason in judged.reasons)
    assert any("time between two images, found" in reason for reason in judged.reasons)


@pytest.mark.slow
def test_a_lens_in_a_map_of_a_wrong_lens_is_as_uncertain_as_that_one(rooms):
    judged = prove(drive(rooms, rooms[2], [CAMERA] * 6, CAMERA, turn=0.03), Lens.of(CAMERA, READOUT_S))
    relative = judged.found.deviations["fx"] / CAMERA.fx
    assert off_in_sigmas(judged, Lens.of(CAMERA, READOUT_S)).max() < 3.0
    assert relative > 0.01


def test_a_turn_is_no_difference_of_lenses():
    shifted = replace(CAMERA, cx=CAMERA.cx + 0.5)
    assert lens_distance(Lens.of(CAMERA), Lens.of(shifted)) < 0.25
    assert lens_distance(Lens.of(CAMERA), Lens.of(OTHER)) > 1.0
    assert lens_distance(Lens.of(CAMERA), Lens.of(CAMERA, 0.03), speed=100.0) == pytest.approx(3.0 / np.sqrt(12.0))
    level, velocity = SimpleNamespace(points_map=np.array([[0.0, 0.0, 2.0]])), np.array([0.6, 0.0, 0.0, 0.0, 0.4, 0.0])
    image = SimpleNamespace(levels=[level], T_map_camera=SE3.identity(), velocity=velocity)
    assert speed_in_image(image, Lens.of(CAMERA)) == pytest.approx(0.5 * CAMERA.pixels_per_radian)


def test_what_a_wrong_lens_made_of_a_map_grows_with_the_tangent_as_far_as_it_is_known():
    errors, z = 0.01 * np.arange(1.0, 7.0), 2.0
    lens = replace(Lens.of(CAMERA), map_errors=tuple(errors))
    for tangent, known in ((-0.5, -0.5), (1.5, 1.5), (2.5, 1.5)):
        (found,) = lens.correct_map(np.array([[z * tangent, 0.0, z]]))
        off = -known * (errors[0] + errors[4] * known**2 + errors[5] * known**4) - errors[2]
        np.testing.assert_allclose(found, [z * (tangent + off), -z * errors[3], z])


def test_a_readout_stays_between_none_and_its_limit():
    lens = Lens.of(CAMERA, READOUT_S)
    for step, readout in [(-1.0, 0.0), (0.01, READOUT_S + 0.01), (1.0, MAX_READOUT_S)]:
        assert lens.moved(step * np.eye(len(lens.values))[READOUT]).readout == pytest.approx(readout)


def test_a_pixel_that_becomes_an_outlier_makes_no_leap_in_likelihood(monkeypatch):
    before = np.tile([-1.0, 1.0, -1.0, 1.0, 10.0], 2 * proof.MIN_PIXELS)
    sigma = weigh(before, proof.MIN_SIGMA)[1]
    sides = [np.where(before > 2.0, share * proof.HUBER * sigma, before) for share in (1.001, 0.999)]
    monkeypatch.setattr(proof, "settle_image", lambda *_: sides.pop())
    lens = Lens.of(CAMERA)
    assert abs(proof.likelihood_ratio([None], [None], lens, lens)[0]) < 0.01
