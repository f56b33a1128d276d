"""A recorded drive, localised in the map image by image: what is shown of it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

from dense_localizer.judge.residual import residual_image
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Bytes
from sphere_nav.localization.status import Status
from sphere_nav.params import build
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.spheres.sphere import to_gray_bytes, to_rgb
from sphere_nav_tools.offline.recorded_camera import RecordedCamera


@dataclass(frozen=True, eq=False)
class Shot:
    """One image (H, W) grey or (H, W, 3), what the map does not explain of it, and what the localiser says."""

    stamp_ns: int
    image: Bytes
    residual: Bytes | None
    T_map_camera: SE3 | None
    status: Status

    @property
    def text(self) -> str:
        """State, reason and quality, in words."""
        status = self.status
        words = [f"**{status.state}**", status.reason, f"{self.stamp_ns / 1e9:.2f} s", f"quality {status.quality:.2f}"]
        return " · ".join(word for word in words if word)


class Drive:
    """Images of a bag through a localiser of their own."""

    def __init__(self, arguments: argparse.Namespace, sphere_map: MapReader) -> None:
        self._recorded = RecordedCamera(arguments.bag, arguments)
        given = self._recorded.patience | arguments.settings
        self._localizer = Localizer(build(LocalizerParams, given), sphere_map)

    @property
    def camera(self) -> Camera:
        """What took the images."""
        return self._recorded.camera

    def shots(self) -> Iterator[Shot]:
        """Yield what is known of every image, in order. BagError for damage."""
        for stamp, image in self._recorded.images():
            gray = to_gray_bytes(image)
            estimate = self._localizer.update(gray, self.camera, stamp)
            residual = residual_image(gray, self.camera, estimate.candidate) if estimate.candidate is not None else None
            yield Shot(stamp, to_rgb(image), residual, estimate.T_map_camera, estimate.status)

    def close(self) -> None:
        """End what the localiser prepares."""
        self._localizer.references.close()
