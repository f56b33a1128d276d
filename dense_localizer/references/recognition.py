"""Which key spheres an image may be of, and from where: by what they look like, at any heading (M15 section 3.5.2).

The cost does not grow with the map: so many spheres are compared, however many there are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dense_localizer.constants import MIN_POSE_INLIERS, NUM_MATCHED, NUM_RETRIEVED
from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.photometric import Pyramid
from sphere_nav.spheres.appearance.features import Features, features_of_image
from sphere_nav.spheres.appearance.index import AppearanceIndex, Likeness
from sphere_nav.spheres.appearance.pose import find_pose
from sphere_nav.spheres.sphere import T_BODY_OPTICAL


class Recognition:
    """What one image shows of the key spheres of a map."""

    def __init__(self, index: AppearanceIndex, pyramid: Pyramid) -> None:
        self._index, level = index, pyramid.levels[0]
        self._T_body_camera = find_body_axes(level.camera)
        image = level.image[:, level.pad : level.pad + level.camera.width]
        found = features_of_image(image.astype(np.float32), level.camera)
        rays = (found.rays @ self._T_body_camera.rotation.T).astype(np.float32)
        self._features: Features = replace(found, rays=rays)
        self.alike: list[Likeness] = index.find(self._features, NUM_RETRIEVED)

    def match_poses(self) -> Iterator[tuple[int, SE3]]:
        """Yield ids of key spheres and T_sphere_camera where enough features match."""
        for one in self.alike[:NUM_MATCHED]:
            pose = find_pose(self._features, self._index.features[one.sphere_id])
            if pose is not None and pose.num_inliers >= MIN_POSE_INLIERS:
                yield one.sphere_id, pose.T_sphere_camera @ self._T_body_camera


def find_body_axes(camera: Camera) -> SE3:
    """Return T_body_camera of an upright camera: a sphere has body axes, all others have optical ones."""
    return SE3.identity() if isinstance(camera, Spherical) else T_BODY_OPTICAL
