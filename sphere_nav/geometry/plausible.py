"""Is this a length in metres? What anyone sends is asked once, where it is converted, before the scene is blamed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import Camera

SAMPLE_STEP = 8  # pixels between those that are looked at
BOUNDS = {  # m between which a length of a kind lies; a factor of 1000 is far outside of them
    "depth": (0.01, 200.0),  # the median of an image
    "baseline": (0.002, 5.0),
    "scan": (0.01, 200.0),  # the median of a turn
    "mounting": (0.0, 25.0),  # of a camera on its vehicle
}
MAX_OFF_CENTER = 0.2  # of an image's size, from its middle to the principal point; binning moves that by 0.25 or 0.5


def check_length(kind: str, length_m: float, where: str) -> None:
    """Raise ValueError, with the factor that would mend it, unless a length is one in metres."""
    low, high = BOUNDS[kind]
    if low <= length_m <= high or not math.isfinite(length_m):
        return
    factor, unit = (0.001, "millimetres") if length_m > high else (1000.0, "kilometres")
    raise ValueError(
        f"{where}: expected metres, {low:g} to {high:g}, found {length_m:.4g}: {unit}? (factor {factor:g})"
    )


def check_lengths(kind: str, lengths_m: NDArray[np.floating], where: str) -> None:
    """Check the median of those lengths that are measured; `where` stands before it."""
    measured = lengths_m[np.isfinite(lengths_m) & (lengths_m > 0.0)]
    if measured.size:
        check_length(kind, float(np.median(measured)), f"{where}: median")


def check_mounting(position_m: Array, where: str) -> None:
    """Check where a camera sits on its vehicle, (3,) m."""
    check_length("mounting", float(np.linalg.norm(position_m)), where)


def check_center(camera: Camera, where: str) -> None:
    """Raise ValueError where the principal point is far from the middle: numbers of an image of another size."""
    center, size = np.array([camera.cx, camera.cy]), np.array([camera.width, camera.height])  # type: ignore[attr-defined]
    share = (center + 0.5) / size
    if np.abs(share - 0.5).max() <= MAX_OFF_CENTER:
        return
    found = f"{center[0]:.4g}, {center[1]:.4g} in {size[0]} x {size[1]}"
    advice = "of another size? binning_x, binning_y and roi of camera_info tell binned and cut images"
    raise ValueError(f"{where}: expected the principal point about the middle of the image, found {found}: {advice}")
