"""The last image as a reference (M15 section 5.3): range, covariance of a way, other light, a hidden map."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import PosePrior
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.track.visual_odometry import VisualOdometry, Way, find_finest_level, make_view, warp_range
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.localization.status import Reason, Verdict
from sphere_nav.params import build
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, at, locate, make_map
from worlds.room import sharp_room

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration


def test_an_image_that_was_placed_is_a_reference(room):
    T_sphere, pose = SE3.from_planar(0.3, 0.2, 0.0), at(0.0, 0.0, 0.4)
    sphere = room.sphere(T_sphere, Spherical(512, 256))
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS), T_sphere)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.pyramid), views=(view,))
    step = SE3.exp([0.04, -0.02, 0.05, 0.01, -0.02, 0.01])
    now = build_pyramid(room.photograph(PINHOLE, pose @ step, 5), PINHOLE, PARAMS.pyramid)
    alignment = register(now, [make_view(image, pose, PARAMS)], pose, PARAMS)
    assert alignment.is_converged
    assert np.all(np.less(alignment.T_world_camera.distance(pose @ step), (0.006, 0.004)))


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


def test_a_place_that_was_unsure_along_the_street_stays_so_however_the_camera_turns():
    turned, start = SE3.from_planar(0.0, 0.0, 0.6), np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = Way(SE3.identity(), start, 0).covariance_at(turned)[:3, :3]
    np.testing.assert_allclose(turned.rotation @ found @ turned.rotation.T, start[:3, :3], atol=1e-12)


def test_a_way_by_images_alone_drifts_with_its_length():
    way = Way(SE3.identity(), np.zeros((6, 6)), 0)
    for k in range(10):
        way = way.add_step(SE3.from_planar(k, 0.0, 0.0), SE3.from_planar(k + 1.0, 0.0, 0.0), np.zeros((6, 6)))
    sigma = np.sqrt(np.diag(way.covariance_at(SE3.from_planar(10.0, 0.0, 0.0))))
    np.testing.assert_allclose(sigma, np.repeat([0.2, 0.04], 3))  # 2 % and 4 mrad a metre


LOCALIZER = build(LocalizerParams, SMALL_IMAGES | {"prior.max_blind_m": 0.1})


@pytest.fixture(scope="module")
def maps(room):
    other = sharp_room((5.0, 3.0, 1.5), seed=3)
    found = [References(make_map(one, [SE3.identity()]), LOCALIZER) for one in (room, other)]
    Track(room, found[0]).see(at(0.0))  # what that loads is charged to no test
    yield found
    for one in found:
        one.close()


class Track:
    def __init__(self, room, references):
        self.room, self.prior, self.k = room, PosePrior(LOCALIZER.prior), 0
        self.visual_odometry = VisualOdometry(references, LOCALIZER)
        self.use(references)
        self.prior.start(at(0.0), 1e-5 * np.eye(6), 0)

    def use(self, references):
        self.references = self.visual_odometry._references = references

    def see(self, pose, change=lambda by_map: by_map, *, is_trusted=True):
        """Return the candidate by the map, changed, and the one in force."""
        self.k += 1
        image = self.room.photograph(PINHOLE, pose, self.k)
        seen = RigImage(build_pyramid(image.astype(np.uint8), PINHOLE))
        frame = LocalizerInput(self.k * STEP_NS, images=(seen,))
        by_map = change(locate((seen,), self.references, LOCALIZER, self.prior.propose(frame)))
        found = self.visual_odometry.verify(frame, by_map, is_trusted=is_trusted)
        if found.is_accepted:
            self.prior.correct(found.T_map_camera, found.covariance, frame.stamp_ns, noise=found.noise)
            if found.is_by_map:
                self.visual_odometry.start(found, frame.stamp_ns)
        return by_map, found


@pytest.fixture
def track(room, maps):
    """One that the map has placed three times, at 0.4 m/s."""
    made = Track(room, maps[0])
    for k in range(1, 4):
        assert made.see(at(0.02 * k))[1].is_by_map
    return made


def hidden(by_map):
    return by_map.refuse(Verdict(Reason.OUTLIERS))


def test_where_the_map_is_of_another_place_the_last_image_places_and_its_errors_add_up(track, maps):
    track.use(maps[1])
    steps = []
    for k in range(4, 6):
        by_map, found = track.see(at(0.02 * k))
        assert not by_map.is_accepted
        assert (found.is_accepted, found.is_by_map) == (True, False)
        assert np.all(np.less(found.T_map_camera.distance(at(0.02 * k)), (0.02, 0.01)))
        assert track.visual_odometry.is_needed
        steps.append(np.trace(found.alignment.covariance))
        exact = replace(track.visual_odometry._way, noise=np.zeros((6, 6))).covariance_at(found.T_map_camera)
        assert np.trace(found.covariance - exact) == pytest.approx(sum(steps), rel=0.2)


def test_images_alone_place_what_is_trusted_and_recent_for_a_stated_way(track):
    assert not track.see(at(0.08), hidden, is_trusted=False)[1].is_accepted
    assert track.see(at(0.1), hidden)[1].is_accepted
    track.k += 6  # 0.3 s without an image
    assert not track.see(at(0.24), hidden)[1].is_accepted
    assert track.see(at(0.26))[1].is_by_map
    found = [track.see(at(0.26 + 0.04 * k), hidden)[1] for k in range(1, 6)]
    assert [one.is_accepted for one in found] == [True, True, True, False, False]  # beyond 0.1 m
    assert "by the last images alone for 0.1 m of 0.1" in found[2].finding.detail
    track.visual_odometry.reset()
    assert not track.visual_odometry.is_needed


@pytest.mark.parametrize(
    ("seen", "is_believed"), [({}, True), ({"is_by_parts": True}, False), ({"is_biased": True}, False)]
)
def test_odometry_is_defied_by_a_whole_view_alone(track, seen, is_believed):
    """A view of repeated texture, right in its middle, came to 0.5 m off right odometry, and into TRACKING."""

    def defy(by_map):
        return replace(by_map, prediction=replace(by_map.prediction, defies_odometry=True), **seen)

    _, found = track.see(at(0.08), defy)
    assert (found.is_accepted, found.is_by_map) == (is_believed, True)
    assert is_believed or found.finding.reason == "ODOM_STALE"
    assert not track.see(at(0.1), lambda by_map: defy(hidden(by_map)))[1].is_accepted  # nor by images alone


def test_images_alone_place_who_stands_for_a_minute(track):
    odometry = track.visual_odometry
    for age_s, is_placed in [(59.9, True), (60.1, False)]:
        odometry._way = replace(odometry._way, stamp_ns=(track.k + 1) * STEP_NS - round(age_s * 1e9))
        assert track.see(at(0.06), hidden)[1].is_accepted == is_placed


CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
THREE_LEVELS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24))
MOUNT = SE3.from_planar(0.3, 0.1, 0.5) @ T_BODY_OPTICAL


def test_it_is_that_of_the_room(room):
    T_sphere, T_room_body = SE3.from_planar(0.3, 0.2, 0.0), SE3.from_planar(-0.1, 0.1, 0.2)
    sphere = room.sphere(T_sphere, Spherical(512, 256))
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, THREE_LEVELS), T_sphere)
    pyramid = build_pyramid(room.photograph(CAMERA, T_room_body @ MOUNT), CAMERA, THREE_LEVELS.pyramid)
    found = warp_range(RigImage(pyramid, MOUNT, (view,)), T_room_body, THREE_LEVELS)
    _, truth = room.render(CAMERA, T_room_body @ MOUNT)
    known = ~np.isnan(found)
    assert known.mean() > 0.1
    assert np.median(np.abs(found[known] / truth[known] - 1.0)) < 0.01
