"""Where an image may be of by its parts, in a light that no key sphere was taken in.

Grey levels then resemble nothing. But of all headings in all key spheres, edges agree most at the right one
(`spheres/appearance/headings.py`), those of grey levels or, by night, those of local contrast: asked in turn. The
camera stands somewhere about the middle of the sphere, mostly before or behind it; from some such places parts of the
small image are aligned, and most agree from the right one. All this is a first guess: the proof is that of the whole
image.
"""

from __future__ import annotations

import numpy as np

from dense_localizer.constants import (
    FORWARD_STEP,
    NUM_BY_PARTS,
    NUM_COARSE_LEVELS,
    NUM_HEADINGS,
    NUM_LAID_OUT,
    NUM_VERIFIED,
)
from dense_localizer.references.coarse_reference import stop_at
from dense_localizer.references.recognition import find_body_axes
from dense_localizer.references.reference import References
from dense_localizer.start.guesses import Guess, select_best
from sphere_nav.geometry import SE3
from sphere_nav.photometric import Pyramid, RegistrationParams, View
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.constants import CONTRAST_ANGLE, FITTED_CELLS, MAX_PREDICTED_CHANCE
from sphere_nav.photometric.parts.registration import PartsAlignment, register_parts
from sphere_nav.photometric.pixels.contrast import local_contrast
from sphere_nav.spheres.appearance.headings import GRID, PartedView, cut_view, rank_headings
from sphere_nav.spheres.graph import KeySphere


class PartsSearch:
    """Ranks the key spheres of a map by the edges of an image; of a large map, others of them each time."""

    def __init__(self, references: References, params: RegistrationParams) -> None:
        self._references, self._params, self._count = references, params, 0

    def propose(self, seen: RigImage, T_level_body: SE3) -> list[Guess]:
        """Return the poses on which most parts agree, the likeliest first; `T_level_body`: body axes, heading 0."""
        T_level_camera = T_level_body @ find_body_axes(seen.pyramid.cameras[0])
        num_ways = 1 + self._references.knows_contrast
        round_number, by_contrast = self._count // num_ways, bool(self._count % num_ways)
        self._count += 1
        view, guesses = _cut(seen.pyramid, T_level_camera, by_contrast=by_contrast), []
        for node in self._nodes_of(round_number):
            for heading in rank_headings(view, self._references.coarse.panorama(node.id, by_contrast), NUM_HEADINGS):
                T_sphere_camera = SE3.from_planar(0.0, 0.0, heading.yaw) @ T_level_camera
                guesses.append(Guess(node, node.T_map_sphere @ T_sphere_camera, heading.score))
        aligned = [self._align(seen, one) for one in select_best(guesses, NUM_BY_PARTS)]
        return select_best([one for one in aligned if one.score > FITTED_CELLS], NUM_VERIFIED)

    def _nodes_of(self, round_number: int) -> list[KeySphere]:
        """Return all key spheres, of a large map every so many-th, beginning with another one each round."""
        nodes = list(self._references.nodes)
        step = max(1, -(-len(nodes) // NUM_LAID_OUT))
        return nodes[round_number % step :: step]

    def _align(self, seen: RigImage, guess: Guess) -> Guess:
        """Return the pose, of some before and behind a guess, on which most parts of the small image agree."""
        coarse, pose = self._references.coarse[guess.node.id], guess.T_map_camera
        reach = FORWARD_STEP * (coarse.typical_range_m if np.isfinite(coarse.typical_range_m) else 0.0)
        ahead = pose.rotation @ find_body_axes(seen.pyramid.cameras[0]).rotation.T @ np.array([1.0, 0.0, 0.0])
        best: PartsAlignment | None = None
        for step in (0.0, reach, -reach):
            found = self._register(seen, guess.node, SE3.from_parts(pose.rotation, pose.translation + step * ahead))
            best = found if best is None or found.num_agreeing > best.num_agreeing else best
            if best.chance <= MAX_PREDICTED_CHANCE:
                break
        assert best is not None
        return Guess(guess.node, best.T_world_body, float(best.num_agreeing))

    def _register(self, seen: RigImage, node: KeySphere, T_map_camera: SE3) -> PartsAlignment:
        params = stop_at(len(seen.pyramid.levels) - NUM_COARSE_LEVELS, self._params)
        view = View(self._references.coarse.reference(node.id), node.T_map_sphere)
        return register_parts([RigImage(seen.pyramid, views=(view,))], T_map_camera, params)


def _cut(pyramid: Pyramid, T_level_camera: SE3, *, by_contrast: bool) -> PartedView:
    """Return the edges of an image, or of its local contrast at the resolution at which they are compared."""
    if not by_contrast:
        return cut_view(pyramid.images[0], pyramid.cameras[0], T_level_camera)
    coarse = (one for one in pyramid.levels if one.camera.pixels_per_radian <= np.sqrt(2.0) * GRID.pixels_per_radian)
    level = next(coarse, pyramid.levels[-1])
    return cut_view(local_contrast(level.unpadded, level.camera, CONTRAST_ANGLE), level.camera, T_level_camera)
