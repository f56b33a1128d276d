"""The range of an image by its references: that of the room, at the pixels that an alignment would choose."""

import numpy as np

from dense_localizer.track.visual_odometry import warp_range
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24))
MOUNT = SE3.from_planar(0.3, 0.1, 0.5) @ T_BODY_OPTICAL


def test_it_is_that_of_the_room(room):
    T_sphere, T_room_body = SE3.from_planar(0.3, 0.2, 0.0), SE3.from_planar(-0.1, 0.1, 0.2)
    sphere = room.sphere(T_sphere, Spherical(512, 256))
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS), T_sphere)
    pyramid = build_pyramid(room.photograph(CAMERA, T_room_body @ MOUNT), CAMERA, PARAMS.pyramid)
    found = warp_range(RigImage(pyramid, MOUNT, (view,)), T_room_body, PARAMS)
    _, truth = room.render(CAMERA, T_room_body @ MOUNT)
    known = ~np.isnan(found)
    assert known.mean() > 0.1
    assert np.median(np.abs(found[known] / truth[known] - 1.0)) < 0.01
