"""Which key spheres an image may be of, and from where: by what they look like, at any heading (M15 section 3.5.2).

The cost does not grow with the map: so many spheres are compared, however many there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
    """What one image shows of the key spheres of a map, for each attitude that its camera may have."""

    def __init__(self, index: AppearanceIndex, pyramid: Pyramid, attitudes: Sequence[SE3] = (SE3.identity(),)) -> None:
        """`attitudes`: T_level_body, of the camera's body axes (x ahead, z up) in upright ones of any heading."""
        self._index, level = index, pyramid.levels[0]
        self._T_body_camera = find_body_axes(level.camera)
        found = features_of_image(level.unpadded.astype(np.float32), level.camera)
        self._features = _turn(found, self._T_body_camera)
        self.alike = self._find(attitudes)

    def _find(self, attitudes: Sequence[SE3]) -> list[Likeness]:
        """Return the likest key spheres, each by the attitude at which it is likest."""
        best: dict[int, Likeness] = {}
        for T_level_body in attitudes:
            for one in self._index.find(_turn(self._features, T_level_body), NUM_RETRIEVED):
                if one.sphere_id not in best or one.log_chance < best[one.sphere_id].log_chance:
                    best[one.sphere_id] = one
        return sorted(best.values(), key=lambda one: one.log_chance)[:NUM_RETRIEVED]

    def match_poses(self) -> Iterator[tuple[int, SE3]]:
        """Yield ids of key spheres and T_sphere_camera where enough features match, whatever the attitude."""
        for one in self.alike[:NUM_MATCHED]:
            pose = find_pose(self._features, self._index.features[one.sphere_id])
            if pose is not None and pose.num_inliers >= MIN_POSE_INLIERS:
                yield one.sphere_id, pose.T_sphere_camera @ self._T_body_camera


def find_body_axes(camera: Camera) -> SE3:
    """Return T_body_camera: a sphere has body axes, all others have optical ones."""
    return SE3.identity() if isinstance(camera, Spherical) else T_BODY_OPTICAL


def _turn(features: Features, T: SE3) -> Features:
    return replace(features, rays=(features.rays @ T.rotation.T).astype(np.float32))
