"""What the alignment does not explain, as a picture: grey where image and map agree."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.judge.candidate import PoseCandidate
from sphere_nav.geometry import Camera
from sphere_nav.photometric.pixels.reference import pixels_of

NEUTRAL, HIDDEN = 128, 0


def residual_image(image: NDArray[Any], camera: Camera, candidate: PoseCandidate) -> NDArray[np.uint8]:
    """Return (H, W) uint8: 128 plus half of image minus map at the pixels of the first reference, 128 elsewhere.

    Cells that never show the map are 0. It is of the first camera that a reference covers, else of `image` (H, W).
    """
    if candidate.alignment is None:
        return np.full((camera.height, camera.width), NEUTRAL, np.uint8)
    shown = candidate.images[0]
    image, camera, view = shown.pyramid.images[0], shown.pyramid.cameras[0], shown.views[0]
    picture = np.full((camera.height, camera.width), NEUTRAL, np.uint8)
    level = view.reference.levels[0]
    T_camera_reference = shown.pose(candidate.T_map_camera).inverse() @ view.T_world_reference
    known = pixels_of(level.near(T_camera_reference, camera))  # all of a key sphere would stay with it
    pixels, is_visible = camera.project(T_camera_reference.apply(known[:3].T))
    u, v = np.rint(pixels[is_visible]).astype(np.int64).T
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    u, v = u[inside], v[inside]
    seen = candidate.alignment.gains[0] * image[v, u].astype(np.float32) + candidate.alignment.biases[0]
    difference = np.nan_to_num(seen - known[3, is_visible][inside])
    picture[v, u] = np.clip(NEUTRAL + 0.5 * difference, 0, 255)
    picture[np.isnan(image)] = HIDDEN
    return picture
