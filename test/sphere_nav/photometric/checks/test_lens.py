from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, FrameMotion, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.esm import Alignment, register_rig
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks import lens
from sphere_nav.photometric.checks.lens import NO_STEPS, find_stretches, solve_stretches
from sphere_nav.photometric.constants import LENS_STEP
from sphere_nav.photometric.pixels.samples import Sample
from worlds.room import BESIDE, views_of

PARAMS = RegistrationParams(max_pixels=10_000)
LENSES = [Pinhole(320, 240, 220.0, 220.0, 159.5, 119.5), Fisheye(320, 240, 120.0, 120.0, 159.5, 119.5, (0.02, 0, 0, 0))]
STEP = np.array([0.01, -0.02, 0.03, 0.001, 0.002, -0.001])


def flow(seed, share=0.0, bend=0.0, step=STEP, light=0.0, number=2000):
    """Residuals to first order: the camera is off by a step, its image too large by share + bend r^2, r 1 at a side."""
    rng, focal = np.random.default_rng(seed), 100.0
    at = rng.uniform(-1.0, 1.0, (number, 2))
    pixels, depth = at * [80.0, 60.0], rng.uniform(2.0, 20.0, number)
    points = np.column_stack([pixels / focal, np.ones(number)]) * depth[:, None]
    gradient = rng.normal(0.0, 10.0, (number, 2)) + (6.0 * at if light else 0.0)  # darker in the middle
    by_point = np.zeros((number, 3))
    by_point[:, :2] = gradient * focal / depth[:, None]
    by_point[:, 2] = -np.sum(gradient * pixels, axis=1) / depth
    by_stretch, radius = np.sum(gradient * pixels, axis=1), np.linalg.norm(at, axis=1)
    gray, view = rng.uniform(0, 255, number), np.zeros(number, np.int64)
    sample = Sample(
        view, points, depth, np.zeros((number, 2, 3)), by_point, by_point, by_stretch, gray, np.zeros(number), at
    )
    lamp = light * radius**2
    residual = lamp - sample.by_pose @ step - by_stretch * (share + bend * radius**2)
    return replace(sample, residual=residual + rng.normal(0.0, 3.0, number))


def joined(*samples):
    """One image with a view of each."""
    views = [replace(one, view=np.full(len(one), k)) for k, one in enumerate(samples)]
    return Sample(*(np.concatenate(parts) for parts in zip(*(vars(one).values() for one in views), strict=True)))


def solved(*samples):
    (found,), _ = solve_stretches(joined(*samples), {0: ""})
    return found


@pytest.mark.parametrize("share", [0.0, 0.02, -0.05])
def test_the_stretch_of_a_flow_is_found_with_its_deviation(share):
    found = [solved(flow(seed, share), flow(100 + seed, share)) for seed in range(12)]
    errors = np.array([(one.share - share) / one.sigma for one in found])
    assert np.abs(errors).max() < 4.0
    assert 0.4 < np.mean(errors**2) < 2.2  # chi^2 of 12 over 12, at 0.2 % either way
    assert np.mean([one.sigma for one in found]) < 0.001


def test_a_lamp_that_shines_unevenly_is_no_stretch_and_another_distortion_one_between_centre_and_corner():
    found = solved(flow(1, light=200.0))
    assert abs(found.share) < 0.001
    found = solved(flow(1, bend=0.02))
    assert 0.01 < found.share < 0.04


def test_a_pose_that_takes_a_stretch_over_is_off_by_as_much():
    """Where all is equally far only its distance tells: the pose takes all of it."""
    sample = flow(3, 0.02)
    found = solved(sample)
    J, r = sample.by_pose, sample.residual + sample.by_pose @ STEP
    taken = -np.linalg.lstsq(J, r, rcond=None)[0]  # from the truth to where it is aligned without the stretch
    np.testing.assert_allclose(found.by_share * 0.02, -taken, atol=0.25 * np.linalg.norm(taken))


def test_each_camera_of_a_body_has_its_own():
    both = joined(flow(1, 0.03), flow(2, -0.02))
    (left, right), _ = solve_stretches(replace(both, view=4 * both.view), {0: "left", 1: "right"})
    assert (left.camera, right.camera) == ("left", "right")
    assert (left.share, right.share) == (pytest.approx(0.03, abs=0.003), pytest.approx(-0.02, abs=0.003))


def test_few_cells_tell_nothing():
    sample = flow(1)
    for most in (-0.6, -1.0):
        assert solve_stretches(sample.where(sample.at[:, 0] < most), {0: ""}) == ([], np.inf)


@pytest.fixture(scope="module")
def views(room):
    return views_of(room, PARAMS)


def told(image, views, camera, motion=None, *, is_clear=True):
    """What an image tells, seen again and again, aligned as if it were of a camera."""
    pyramid = build_pyramid(image, camera, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, PARAMS, motion)
    assert alignment.is_converged
    images, longer = [RigImage(pyramid, views=tuple(views))], NO_STEPS
    for _ in range(8):
        found, longer = find_stretches(images, alignment, PARAMS, motion, longer, is_clear=is_clear)
        if found or not longer:
            break
    return found


@pytest.mark.slow
@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.model)
@pytest.mark.parametrize("share", [0.0, -0.03])
def test_the_stretch_of_a_focal_length_is_found_in_images(room, views, camera, share):
    lens = replace(camera, fx=(1 + share) * camera.fx, fy=(1 + share) * camera.fy)
    found = [told(room.photograph(lens, BESIDE, seed), views, camera)[0] for seed in range(4)]
    assert np.mean([one.share for one in found]) == pytest.approx(share, abs=0.005)
    assert np.abs([one.share - share for one in found]).max() < 0.01


@pytest.mark.parametrize("share", [0.12, -0.19])
def test_a_lens_that_is_far_off_is_found_though_something_else_pulls_the_image(room, views, share):
    camera = LENSES[0]
    lens = replace(camera, fx=(1 + share) * camera.fx, fy=(1 + share) * camera.fy)
    (found,) = told(room.photograph(lens, BESIDE, 0), views, camera, is_clear=False)
    assert found.share == pytest.approx(share, abs=0.01)


def test_an_image_costs_one_alignment_and_what_no_longer_explains_it_is_taken_back(room, views, monkeypatch):
    aligned, number = [], 0
    monkeypatch.setattr(lens, "register_rig", lambda *given: aligned.append(given) or register_rig(*given))
    longer, image = dict.fromkeys([""], -10), room.photograph(LENSES[0], BESIDE, 0)
    pyramid = build_pyramid(image, LENSES[0], PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, PARAMS)
    while longer:
        given = [RigImage(pyramid, views=tuple(views))], alignment, PARAMS, None, longer
        (found, longer), number = lens.find_stretches(*given), number + 1
        assert len(aligned) == number <= 4
    assert abs(found[0].share) < 0.01


@pytest.mark.parametrize(("shares", "left"), [((-0.06, -0.06), -6), ((-0.06, -0.005), 0)])
def test_an_image_may_resemble_the_map_less_on_the_way_to_a_lens_not_at_its_end(views, monkeypatch, shares, left):
    answers = iter([([lens.Stretch("", share, 0.002, STEP)], 4.0 + number) for number, share in enumerate(shares)])
    monkeypatch.setattr(lens, "measure_stretches", lambda *_: next(answers))
    pyramid = build_pyramid(np.zeros((240, 320), np.uint8), LENSES[0], PARAMS.pyramid)
    here = Alignment(BESIDE, np.eye(6), "", 1, 1000, 1.0, 1.0, 1.0, 0.9, (1.0,), (0.0,))
    monkeypatch.setattr(lens, "register_rig", lambda *_: here)
    images = [RigImage(pyramid, views=tuple(views))]
    assert find_stretches(images, here, PARAMS, is_clear=False) == ([], {"": left} if left else {})


@pytest.mark.parametrize(
    ("share", "misfit", "share_told", "left"),
    [
        (0.002, 3.6, LENS_STEP**-8 * 1.002 - 1.0, -8),
        (-0.06, 3.6, None, -11),
        (0.002, 3.7, None, 0),
        (0.06, 3.7, None, 0),
    ],
)
def test_where_nothing_is_told_a_lens_that_is_far_off_is_tried(views, monkeypatch, share, misfit, share_told, left):
    """It goes on from there only if the image fits better at once."""
    answers = iter([([lens.Stretch("", -0.014, 0.02, STEP)], 4.0), ([lens.Stretch("", share, 0.002, STEP)], misfit)])
    monkeypatch.setattr(lens, "measure_stretches", lambda *_: next(answers))
    pyramid = build_pyramid(np.zeros((240, 320), np.uint8), LENSES[0], PARAMS.pyramid)
    here = Alignment(BESIDE, np.eye(6), "", 1, 1000, 1.0, 1.0, 1.0, 0.9, (1.0,), (0.0,))
    monkeypatch.setattr(lens, "register_rig", lambda *_: here)
    found, longer = find_stretches([RigImage(pyramid, views=tuple(views))], here, PARAMS, far=-8, is_clear=False)
    assert longer == ({"": left} if left else {})
    assert [one.share for one in found] == ([pytest.approx(share_told)] if share_told else [])


def test_what_pulls_an_image_of_a_right_lens_is_not_told_and_whole_spheres_have_no_lens(room, views):
    image = room.photograph(LENSES[0], BESIDE, 1)
    image[60:180, 100:220] = 90
    assert told(image, views, LENSES[0], is_clear=False) == []
    sphere = Spherical(256, 128)
    assert told(room.photograph(sphere, BESIDE, 1), views, sphere) == []


@pytest.mark.slow
def test_a_rolling_shutter_is_no_stretch(room, views):
    camera, twist = LENSES[0], np.array([0.02, 0.0, 0.03, 0.0, 0.02, 0.0])
    image = np.rint(room.render_rolling(camera, BESIDE, twist)).astype(np.uint8)
    (found,) = told(image, views, camera, FrameMotion(BESIDE @ SE3.exp(-twist), 1.0))
    assert abs(found.share) < max(0.005, 4.0 * found.sigma)
