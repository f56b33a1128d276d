"""One instant after the other: by the map, or by the last images, and which of the two is believed."""

import numpy as np

from dense_localizer.judge.estimate import Frame
from dense_localizer.motion_prior import MotionPrior
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.track.tracker import Tracker
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.structure import EVERYTHING
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, at, make_map
from worlds.room import sharp_room

PARAMS = build(LocalizerParams, SMALL_IMAGES)


class Track:
    def __init__(self, room, sphere_map):
        self.room, self.prior, self.k = room, MotionPrior(PARAMS.prior), 0
        self.tracker = Tracker(References(sphere_map, PARAMS), PARAMS, self.prior)
        self.prior.start(at(0.0), 1e-5 * np.eye(6), 0)

    def see(self, pose, room=None):
        self.k += 1
        image = RigImage(build_pyramid((room or self.room).photograph(PINHOLE, pose, self.k), PINHOLE))
        frame = Frame(self.k * STEP_NS, FINE, (image,), None)
        place, prediction = self.tracker.locate(frame, EVERYTHING)
        other = None if place.verdict.is_accepted else self.tracker.propagate(frame, place, prediction)
        found = place if place.verdict.is_accepted else other
        if found is not None:
            self.prior.correct(found.T_map_camera, found.covariance, frame.stamp_ns, noise=found.noise)
        self.tracker.remember(frame)
        return place, other


def test_the_map_places_images_and_another_room_is_refused_by_both(room, room_map):
    track, other = Track(room, room_map), sharp_room((5.0, 3.0, 1.5), seed=3)
    poses = [at(0.01 * k) for k in range(1, 8)]
    for pose in poses[:3]:
        place, by_images = track.see(pose)
        assert (place.verdict.is_accepted, by_images) == (True, None)
    assert track.tracker.images[0].pyramid.cameras[0] == PINHOLE
    place, by_images = track.see(poses[3], other)  # another room: neither map nor last image
    assert not place.verdict.is_accepted
    assert by_images is None
    track.tracker.forget()
    assert track.tracker.images == ()


def test_the_last_image_places_what_the_map_refuses(room):
    hidden = make_map(sharp_room((5.0, 3.0, 1.5), seed=3), [SE3.identity()])
    seen = make_map(room, [SE3.identity()])
    track = Track(room, seen)
    for k in range(1, 4):
        track.see(at(0.02 * k))
    references = References(hidden, PARAMS)
    track.tracker._references = track.tracker._odometry._references = references  # the map is another from now on
    for k in range(4, 8):
        place, by_images = track.see(at(0.02 * k))
        assert not place.verdict.is_accepted
        assert by_images.T_map_camera.distance(at(0.02 * k)) < (0.02, 0.01)
