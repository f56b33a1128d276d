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
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, at, locate, make_map
from worlds.room import sharp_room

pytestmark = pytest.mark.slow

PARAMS = build(LocalizerParams, SMALL_IMAGES)


class Track:
    def __init__(self, room, sphere_map):
        self.room, self.prior, self.k = room, PosePrior(PARAMS.prior), 0
        self.references = References(sphere_map, PARAMS)
        self.visual_odometry = VisualOdometry(self.references, PARAMS)
        self.prior.start(at(0.0), 1e-5 * np.eye(6), 0)

    def see(self, pose, change=lambda by_map: by_map, *, is_trusted=True):
        """Return the candidate by the map, changed, and the one in force."""
        self.k += 1
        image = RigImage(build_pyramid(self.room.photograph(PINHOLE, pose, self.k), PINHOLE))
        frame = LocalizerInput(self.k * STEP_NS, images=(image,))
        by_map = change(locate(frame.images, self.references, PARAMS, next(self.prior.propose(frame))))
        found = self.visual_odometry.verify(frame, by_map, is_trusted=is_trusted)
        if found.is_accepted:
            self.prior.correct(found.T_map_camera, found.covariance, frame.stamp_ns, noise=found.noise)
        return by_map, found


def pulled(by_map, off_m):
    """Return a candidate as one that resembles the map little and is off."""
    T = by_map.T_map_camera @ SE3.exp([off_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    return replace(by_map, T_map_camera=T, alignment=replace(by_map.alignment, ncc=0.5))


def test_where_the_map_refuses_or_contradicts_the_last_image_places(room):
    hidden = make_map(sharp_room((5.0, 3.0, 1.5), seed=3), [SE3.identity()])
    track, steps = Track(room, make_map(room, [SE3.identity()])), []
    right = track.references
    for k in range(1, 4):
        track.see(at(0.02 * k))
    track.references = track.visual_odometry._references = References(hidden, PARAMS)  # the map is another from now on
    for k in range(4, 8):
        by_map, found = track.see(at(0.02 * k))
        assert not by_map.is_accepted
        assert (found.is_accepted, found.is_by_map) == (True, False)
        assert found.T_map_camera.distance(at(0.02 * k)) < (0.02, 0.01)
        assert track.visual_odometry.is_needed
        steps.append(np.trace(found.alignment.covariance))
        exact = replace(track.visual_odometry._way, noise=None).covariance_at(found.T_map_camera)
        assert np.trace(found.covariance - exact) == pytest.approx(sum(steps), rel=0.2)  # errors of the steps add up
    track.references = track.visual_odometry._references = right
    by_map, found = track.see(at(0.16), lambda one: pulled(one, 0.5))  # as by a lamp: it fits badly, and elsewhere
    assert (by_map.is_accepted, found.is_by_map) == (True, False)
    assert found.T_map_camera.distance(at(0.16)) < (0.02, 0.01)
    assert track.see(at(0.18), lambda one: pulled(one, 0.0))[1].is_by_map  # where the last images say
    assert not track.visual_odometry.is_needed
    track.references = track.visual_odometry._references = References(hidden, PARAMS)
    _, found = track.see(at(0.2), is_trusted=False)  # a pose on probation is not propagated by images
    assert not found.is_accepted
    track.visual_odometry.reset()
    assert not track.visual_odometry.is_needed
    assert not track.see(at(0.22))[1].is_accepted
