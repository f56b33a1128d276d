"""Pictures of spheres to look at: the image, the range in colours, and the points from beside."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

NEAREST_M, FARTHEST_M = 0.5, 100.0
VIEW = Pinhole(1200, 800, 700.0, 700.0, 599.5, 399.5)


def write_sphere(folder: Path | None, name: str, sphere: Sphere) -> None:
    """Write the image and, in colours, the range; nothing without a folder."""
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / f"{name}.png"), _bgr(sphere.image))
    clipped = np.clip(sphere.range_m, NEAREST_M, FARTHEST_M)
    shade = 255 * np.log(clipped / NEAREST_M) / np.log(FARTHEST_M / NEAREST_M)
    colors = cv2.applyColorMap(np.nan_to_num(shade, nan=0.0).astype(np.uint8), cv2.COLORMAP_JET)
    cv2.imwrite(str(folder / f"{name}_range.png"), colors * sphere.measured[..., None])


def write_cloud(folder: Path | None, name: str, sphere: Sphere, back_m: float = 1.5) -> None:
    """Write the points as seen from behind, above and to the left of the sphere, turned towards it."""
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    points, colors = sphere.points()
    T_sphere_view = SE3.from_planar(-back_m, 0.5 * back_m, -0.3) @ SE3.exp([0.0, 0.0, 0.5 * back_m, 0.0, 0.25, 0.0])
    seen = (T_sphere_view @ T_BODY_OPTICAL).inverse().apply(points.astype(np.float64))
    pixels, visible = VIEW.project(seen)
    order = np.flatnonzero(visible)[np.argsort(-seen[visible, 2])]  # the nearest last
    picture = np.zeros((VIEW.height, VIEW.width, *colors.shape[1:]), np.uint8)
    at: NDArray[np.intp] = np.rint(pixels[order]).astype(np.intp)
    for du in (0, 1):
        for dv in (0, 1):
            rows, columns = np.minimum(at[:, 1] + dv, VIEW.height - 1), np.minimum(at[:, 0] + du, VIEW.width - 1)
            picture[rows, columns] = colors[order]
    cv2.imwrite(str(folder / f"{name}_cloud.png"), _bgr(picture))


def _bgr(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return image[:, :, ::-1] if image.ndim == 3 else image
