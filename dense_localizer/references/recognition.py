"""Which key spheres an image may be of, and from where: by what they look like, at any heading (M15 section 3.5.2).

The cost does not grow with the map: so many spheres are compared, however many there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dense_localizer.constants import MIN_POSE_INLIERS, NUM_CANDIDATES, NUM_MATCHED
from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.photometric import Pyramid
from sphere_nav.spheres.appearance.features import Features, features_of_image
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.appearance.pose import find_pose
from sphere_nav.spheres.sphere import T_BODY_OPTICAL


def recognize(
    index: AppearanceIndex, pyramid: Pyramid, attitudes: Sequence[SE3]
) -> tuple[list[int], list[tuple[int, SE3]]]:
    """Return ids of the likest key spheres, each by the attitude at which it is likest, and poses in them.

    `attitudes`: T_level_body, of the camera's body axes (x ahead, z up) in upright ones of any heading. A pose
    T_sphere_camera is where enough features match, whatever the attitude.
    """
    level = pyramid.levels[0]
    T_body_camera = find_body_axes(level.camera)
    features = _turn(features_of_image(level.unpadded.astype(np.float32), level.camera), T_body_camera)
    chances: dict[int, float] = {}
    for T_level_body in attitudes:
        for one in index.find(_turn(features, T_level_body), NUM_CANDIDATES):
            chances[one.sphere_id] = min(one.log_chance, chances.get(one.sphere_id, np.inf))
    alike = sorted(chances, key=chances.__getitem__)[:NUM_CANDIDATES]
    poses = {one: find_pose(features, index.features[one]) for one in alike[:NUM_MATCHED]}
    return alike, [
        (one, pose.T_sphere_camera @ T_body_camera)
        for one, pose in poses.items()
        if pose is not None and pose.num_inliers >= MIN_POSE_INLIERS
    ]


def find_body_axes(camera: Camera) -> SE3:
    """Return T_body_camera: a sphere has body axes, all others have optical ones."""
    return SE3.identity() if isinstance(camera, Spherical) else T_BODY_OPTICAL


def _turn(features: Features, T: SE3) -> Features:
    return replace(features, rays=(features.rays @ T.rotation.T).astype(np.float32))
