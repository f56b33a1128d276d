"""The last image as a reference (M15 section 5.3): range, covariance of a way, other light, a hidden map."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.judge import integrity
from dense_localizer.params import LocalizerParams
from dense_localizer.track.visual_odometry import Way, find_finest_level, make_view
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.localization.status import Reason, State
from sphere_nav.params import build
from sphere_nav.photometric import View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks import structure
from sphere_nav.photometric.checks.support import NO_SUPPORT
from worlds.localizer import PINHOLE, SMALL_IMAGES, Run, at, error, make_localizer, make_map
from worlds.room import Room, wide_room

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration
STEP_NS, SPEED = 100_000_000, 0.5  # ten images a second, m/s


class RelitRoom(Room):
    """The same walls by another lamp, bright where it hangs, dark beyond."""

    def __init__(self) -> None:
        super().__init__((5.0, 3.0, 1.5), (1.0, 20.0, 30), gain=30.0)

    def gray(self, points):
        plain = super().gray(points)
        lamp = np.exp(-np.sum((points - [1.0, 2.0, 1.0]) ** 2, axis=-1) / 4.0)
        return np.clip(plain * (0.12 + 2.0 * lamp), 1.0, 254.0)


def way(number, first=0):
    return [
        at(-1.9 + SPEED * 0.1 * k, 0.1 * np.sin(0.2 * k), 0.3 * np.sin(0.1 * k)) for k in range(first, first + number)
    ]


def test_an_image_that_was_placed_is_a_reference(room):
    T_sphere, pose = SE3.from_planar(0.3, 0.2, 0.0), at(0.0, 0.0, 0.4)
    sphere = room.sphere(T_sphere, Spherical(512, 256))
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS), T_sphere)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.pyramid), views=(view,))
    step = SE3.exp([0.04, -0.02, 0.05, 0.01, -0.02, 0.01])
    now = build_pyramid(room.photograph(PINHOLE, pose @ step, 5), PINHOLE, PARAMS.pyramid)
    alignment = register(now, [make_view(image, pose, PARAMS)], pose, PARAMS)
    assert alignment.is_converged
    assert alignment.T_world_camera.distance(pose @ step) < (0.006, 0.004)


def test_a_reference_is_made_of_at_most_twice_the_pixels_that_are_aligned():
    cameras = [SimpleNamespace(width=w, height=h) for w, h in ((500, 400), (400, 300), (200, 150))]
    seen = [SimpleNamespace(pyramid=SimpleNamespace(cameras=cameras))]
    assert find_finest_level(seen, LocalizerParams()) == 1


def test_a_way_without_the_map_is_the_less_sure_the_longer_it_is(room):
    rng, sigma = np.random.default_rng(3), 1e-3
    poses = [SE3.exp([0.1 * k, 0.0, 0.02 * k, 0.0, 0.05 * k, 0.0]) for k in range(6)]
    found = Way(poses[0], np.zeros((6, 6)), 0)
    for one, other in pairwise(poses):
        found = found.add_step(one, other, sigma**2 * np.eye(6))
    T = poses[0]
    for one, other in pairwise(poses):  # steps that err
        T = T @ (one.inverse() @ other) @ SE3.exp(rng.normal(0, sigma, (4000, 6)))
    ends = (poses[-1].inverse() @ T).log()
    np.testing.assert_allclose(found.noise, np.cov(ends.T), atol=0.12 * found.noise.max())
    lengths = [one.distance(other)[0] for one, other in pairwise(poses)]
    assert found.meters == pytest.approx(sum(lengths))
    last, exact = poses[-1], np.zeros((6, 6))
    longer = [found.add_step(last, last @ SE3.exp([d, 0, 0, 0, 0, 0]), exact) for d in (0.0, 1.0, 5.0)]
    sigmas = [np.trace(one.covariance_at(last)) for one in longer]
    assert sigmas[0] < sigmas[1] < sigmas[2]


class SoftRoom(Room):
    """No fine texture; a lamp may hang at one side of it, and all else be darker."""

    def __init__(self) -> None:
        super().__init__((5.0, 3.0, 1.5), (1.0, 20.0, 30), gain=30.0, seed=1)
        self.is_lit = False

    def gray(self, points):
        off = np.sum((points - [2.7, -1.7, 0.9]) ** 2, axis=-1)
        factor = 0.31 + 1.96 * np.exp(-off / (2 * 1.47**2)) if self.is_lit else 1.0
        return np.clip(super().gray(points) * factor, 1.0, 254.0)


@pytest.mark.slow
def test_a_lamp_that_pulls_the_map_itself_is_told_or_changes_little():
    room, poses = SoftRoom(), way(30)
    sphere_map = make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0, 1.0)])
    for has_contrast in (True, False):
        run, told = Run(room, make_localizer(sphere_map, alignment__contrast=has_contrast)), []
        run.localizer.relocalize(poses[0])
        for k, pose in enumerate(poses):
            room.is_lit = k >= 10
            told.append(run.see(pose, step_ns=STEP_NS))
        assert told[9].status.state is State.TRACKING
        assert any(one.status.reason == Reason.LIGHT_CHANGE for one in told[10:]) != has_contrast
        for one, pose in zip(told[10:], poses[10:], strict=True):  # grey: 0.37 m off in TRACKING without that evidence
            assert one.status.state is (State.TRACKING if has_contrast else State.DEGRADED)
            assert error(one, pose)[0] < 0.05


@pytest.mark.slow
def test_a_map_that_stays_hidden_is_told_and_lost_after_the_stated_distance(room_map, monkeypatch):
    monkeypatch.setattr(integrity, "align_by_parts", lambda alignment, *_: alignment)
    monkeypatch.setattr(structure, "find_support", lambda *_: NO_SUPPORT)  # no part of it is seen, either
    run = Run(wide_room(), make_localizer(room_map, prior__max_blind_m=1.0, alignment__contrast=False))
    for pose in way(12):
        run.see(pose, step_ns=STEP_NS)
    run.room, told = RelitRoom(), []
    for pose in way(34, 12):
        told.append(run.see(pose, step_ns=STEP_NS))
    degraded = [estimate for estimate in told if estimate.status.state is State.DEGRADED]
    assert degraded[3].status.reason
    assert "by the last images alone for" in degraded[3].status.remedy
    blind = [estimate for estimate in degraded if "by the last images alone for" in estimate.status.remedy]
    assert np.all(np.diff([np.trace(estimate.covariance[:3, :3]) for estimate in blind]) > 0)
    first = next(k for k, estimate in enumerate(told) if estimate.status.state is State.LOST)
    assert 1.0 < 0.05 * first < 1.6  # a metre, half a second without anything
    assert told[first].T_map_camera is None


def test_a_way_by_images_alone_drifts_with_its_length():
    way = Way(SE3.identity(), np.zeros((6, 6)), 0)
    for k in range(10):
        way = way.add_step(SE3.from_planar(k, 0.0, 0.0), SE3.from_planar(k + 1.0, 0.0, 0.0), np.zeros((6, 6)))
    sigma = np.sqrt(np.diag(way.covariance_at(SE3.from_planar(10.0, 0.0, 0.0))))
    np.testing.assert_allclose(sigma, np.repeat([0.2, 0.04], 3))  # 2 % and 4 mrad a metre
