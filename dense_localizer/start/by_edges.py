"""Where an image may be of by its edges, in a light that no key sphere was taken in.

Grey levels then resemble nothing. But of all headings in all key spheres, edges agree most at the right one
(`spheres/appearance/headings.py`): those of local contrast, which no lamp draws, where the map has texture enough for
it. The camera stands somewhere about the middle of the sphere, mostly before or behind it. All this is a first guess:
the proof is that of the whole image.
"""

from __future__ import annotations

import numpy as np

from dense_localizer.constants import NUM_HEADINGS, NUM_LAID_OUT, NUM_VERIFIED
from dense_localizer.references.recognition import find_body_axes
from dense_localizer.references.reference import References
from dense_localizer.start.guesses import Guess, select_best
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.constants import CONTRAST_ANGLE
from sphere_nav.photometric.pixels.contrast import local_contrast
from sphere_nav.spheres.appearance.headings import GRID, PartedView, cut_view, rank_headings
from sphere_nav.spheres.graph import KeySphere


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
