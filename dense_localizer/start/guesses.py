"""Poses that a search tries, the likeliest first, all of them different places.

By what key spheres look like, at any heading (M15 section 3.5.2): the cost does not grow with the map, so many spheres
are compared, however many there are (`recognize`).

By edges, in a light that no key sphere was taken in: grey levels then resemble nothing, but of all headings in all key
spheres edges agree most at the right one (`spheres/appearance/headings.py`): those of local contrast, which no lamp
draws, where the map has texture enough for it. The camera stands somewhere about the middle of the sphere, mostly
before or behind it. All this is a first guess: the proof is that of the whole image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dense_localizer.constants import (
    MIN_POSE_INLIERS,
    NUM_CANDIDATES,
    NUM_HEADINGS,
    NUM_LAID_OUT,
    NUM_MATCHED,
    NUM_VERIFIED,
    SAME_POSE_DEG,
    SAME_POSE_M,
)
from dense_localizer.references.reference import References
from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.constants import CONTRAST_ANGLE
from sphere_nav.photometric.pixels.contrast import local_contrast
from sphere_nav.spheres.appearance.features import Features, features_of_image
from sphere_nav.spheres.appearance.headings import GRID, PartedView, cut_view, rank_headings
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.appearance.pose import find_pose
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.sphere import T_BODY_OPTICAL


@dataclass(frozen=True)
class Guess:
    """A pose to try against one key sphere, and how much speaks for it: how well the image resembles it there."""

    node: KeySphere
    T_map_camera: SE3
    score: float = -1.0


def select_best(guesses: Sequence[Guess], count: int) -> list[Guess]:
    """Return the guesses for which most speaks; equal ones stay in the order of the map."""
    return sorted(guesses, key=lambda guess: -guess.score)[:count]


def select_distinct(guesses: Sequence[Guess], count: int) -> list[Guess]:
    """Return the first so many guesses that are different places."""
    kept: list[Guess] = []
    for guess in guesses:
        if len(kept) == count:
            break
        if not any(is_same_pose(guess.T_map_camera, other.T_map_camera) for other in kept):
            kept.append(guess)
    return kept


def is_same_pose(a: SE3, b: SE3) -> bool:
    """Say whether two poses are one place."""
    distance, angle = a.distance(b)
    return bool(distance < SAME_POSE_M and angle < np.radians(SAME_POSE_DEG))


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


class EdgeSearch:
    """Ranks the key spheres of a map by the edges of an image; of a large map, others of them each time."""

    def __init__(self, references: References) -> None:
        self._references, self._count = references, 0

    def propose(self, seen: RigImage, T_level_body: SE3) -> list[Guess]:
        """Return poses at the headings whose edges agree most, the likeliest first; that one also before and behind.

        `T_level_body`: body axes, heading 0.
        """
        T_level_camera = T_level_body @ find_body_axes(seen.pyramid.cameras[0])
        by_contrast = self._references.knows_contrast
        view, guesses = _cut(seen.pyramid, T_level_camera, by_contrast=by_contrast), []
        for node in self._next_nodes():
            for heading in rank_headings(view, self._references.coarse.panorama(node.id, by_contrast), NUM_HEADINGS):
                T_sphere_camera = SE3.from_planar(0.0, 0.0, heading.yaw) @ T_level_camera
                guesses.append(Guess(node, node.T_map_sphere @ T_sphere_camera, heading.score))
        ahead = find_body_axes(seen.pyramid.cameras[0]).rotation.T[:, 0]
        best = select_best(guesses, NUM_VERIFIED)
        return [one for guess in best[:1] for one in self._step(guess, ahead)] + best[1:]

    def _next_nodes(self) -> list[KeySphere]:
        """Return all key spheres, of a large map every so many-th, beginning with another one each time."""
        nodes = list(self._references.nodes)
        step = max(1, -(-len(nodes) // NUM_LAID_OUT))
        first, self._count = self._count % step, self._count + 1
        return nodes[first::step]

    def _step(self, guess: Guess, ahead: Array) -> list[Guess]:
        """Return a guess, and the same behind and before it by a share of the range."""
        pose, step_m = guess.T_map_camera, self._references.coarse[guess.node.id].step_m
        steps = (pose @ SE3.from_parts(np.eye(3), meters * ahead) for meters in (0.0, -step_m, step_m))
        return [Guess(guess.node, one, guess.score) for one in steps]


def _cut(pyramid: Pyramid, T_level_camera: SE3, *, by_contrast: bool) -> PartedView:
    """Return the edges of an image, or of its local contrast at the resolution at which they are compared."""
    if not by_contrast:
        return cut_view(pyramid.images[0], pyramid.cameras[0], T_level_camera)
    coarse = (one for one in pyramid.levels if one.camera.pixels_per_radian <= np.sqrt(2.0) * GRID.pixels_per_radian)
    level = next(coarse, pyramid.levels[-1])
    return cut_view(local_contrast(level.unpadded, level.camera, CONTRAST_ANGLE), level.camera, T_level_camera)
