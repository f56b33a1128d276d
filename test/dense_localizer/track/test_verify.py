"""One instant after the other: by the map, or by the last images, and which of the two is believed."""

from dataclasses import replace

import numpy as np
import pytest

from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import PosePrior
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.track.visual_odometry import VisualOdometry
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Reason, Verdict
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, at, locate, make_map
from worlds.room import sharp_room

PARAMS = build(LocalizerParams, SMALL_IMAGES | {"prior.max_blind_m": 0.1})


@pytest.fixture(scope="module")
def maps(room):
    other = sharp_room((5.0, 3.0, 1.5), seed=3)
    found = [References(make_map(one, [SE3.identity()]), PARAMS) for one in (room, other)]
    Track(room, found[0]).see(at(0.0))  # what that loads is charged to no test
    yield found
    for one in found:
        one.close()


class Track:
    def __init__(self, room, references):
        self.room, self.prior, self.k = room, PosePrior(PARAMS.prior), 0
        self.visual_odometry = VisualOdometry(references, PARAMS)
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
        by_map = change(locate((seen,), self.references, PARAMS, next(self.prior.propose(frame))))
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
        assert found.T_map_camera.distance(at(0.02 * k)) < (0.02, 0.01)
        assert track.visual_odometry.is_needed
        steps.append(np.trace(found.alignment.covariance))
        exact = replace(track.visual_odometry._way, noise=None).covariance_at(found.T_map_camera)
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


def test_images_alone_place_who_stands_for_a_minute(track):
    odometry = track.visual_odometry
    for age_s, is_placed in [(59.9, True), (60.1, False)]:
        odometry._way = replace(odometry._way, stamp_ns=(track.k + 1) * STEP_NS - round(age_s * 1e9))
        assert track.see(at(0.06), hidden)[1].is_accepted == is_placed
