"""READ FIRST. The images of a rig at one instant -> an augmented sphere (M15 section 4.3).

For each instant: make the light of all images equal; find the range (a vertical rig draws a top and a bottom sphere,
matches them along their columns, triangulates, and moves the range to the common centre; any other rig compares all
cameras that see a direction, on the sphere itself); fuse it with what depth cameras and a LiDAR measure; blend the
images, each pixel taken from where its point is seen. A camera that is missing leaves a hole.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.light.light import Learned, Light
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.fusion import (
    Ranged,
    fuse_sources,
    inverse_range,
    range_from_cloud,
    range_from_depth,
)
from sphere_mapping.acquisition.range.lens_check import check_lenses
from sphere_mapping.acquisition.range.rectification import Matches, matches_of
from sphere_mapping.acquisition.range.sweep import SphereSweep
from sphere_mapping.acquisition.range.vertical import VerticalStereo
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_nav.geometry import Rig
from sphere_nav.geometry.arrays import Array, Bytes
from sphere_nav.spheres.sphere import Sphere, check_depth, check_sphere_image, to_gray_bytes


class Stitcher:
    """Holds the tables of a rig. `T_rig_sphere` is where its spheres are; `jobs` threads change nothing but time.

    `warning`: why there will be no range from stereo, empty where there will be.
    """

    def __init__(
        self, rig: Rig, params: StitchParams | None = None, masks: Mapping[str, Bytes] | None = None, jobs: int = 1
    ) -> None:
        self.rig, self.params, self.masks = rig, params or StitchParams(), dict(masks or {})
        self.layouts = Layouts(rig, self.params, self.masks)
        self.whole, self.T_rig_sphere = self.layouts.whole, self.layouts.T_rig_sphere
        groups = {part.name: part.exposure_group or f"alone {part.name}" for part in rig.cameras}
        views = list(self.layouts.views.values())
        self._light = Light(views, groups, self.params.blend.distance_m)
        self.stereo: VerticalStereo | SphereSweep | None = None
        if self.params.range != "none":
            kind = VerticalStereo if rig.is_vertical else SphereSweep
            self.stereo = kind(self.layouts, self.params, jobs)
        self.warning = self.stereo.warning if self.stereo is not None else ""
        self._has_lenses = False  # whether they are checked; once is enough: lenses do not change

    def stitch(
        self,
        images: Mapping[str, Bytes],
        stamp_ns: int = 0,
        points_rig: NDArray[np.floating] | None = None,
        depths: Mapping[str, NDArray[np.floating]] | None = None,
    ) -> Sphere:
        """Return the sphere of one instant from the images by camera, all grey or all RGB; cameras may be missing.

        points_rig (N, 3): a LiDAR's cloud of the instant in the frame of the rig. depths: of RGB-D cameras, (h, w) m
        along the axis, registered to the image.
        """
        equal, _ = self.equalize(images)
        sources = [*self._find_range(equal), *self._project_depths(depths or {}), *self._project_points(points_rig)]
        range_m, std_m = fuse_sources(sources, self.whole)
        layout = self.layouts.of("top" if self.rig.is_vertical else "", tuple(equal))
        image = blend(layout, equal, inverse_range(range_m, layout.is_covered))
        range_m[~layout.is_covered] = np.nan
        std_m[~np.isfinite(range_m)] = np.nan
        return Sphere(image, range_m, self.whole, stamp_ns, std_m)

    def equalize(self, images: Mapping[str, Bytes]) -> tuple[dict[str, Bytes], dict[str, Array]]:
        """Return the checked images with their exposures made equal, in the order of the rig, and the gains."""
        if not images:
            raise ValueError(f"rig {self.rig.name}: expected at least one image, found none")
        for name, image in images.items():
            check_sphere_image(image, self.rig.camera(name).camera, f"{name}: image")
        kinds = {image.ndim for image in images.values()}
        if len(kinds) > 1:
            raise ValueError(f"rig {self.rig.name}: images: expected all grey or all RGB, found both")
        ordered = {name: images[name] for name in self.rig.names if name in images}
        return self._light.balance(ordered)

    def matches(self, images: Mapping[str, Bytes], points_rig: NDArray[np.floating] | None = None) -> list[Matches]:
        """Return the features that cameras share at one instant, for `rectify`; points_rig as for `stitch`."""
        grays = _to_grays(self.equalize(images)[0])
        points = None if points_rig is None else self._to_sphere(points_rig)
        return matches_of(list(self.layouts.views.values()), grays, points)

    @property
    def is_settled(self) -> bool:
        """Whether it has learned and checked all that it will: an instant then depends on nothing before."""
        has_checked = self.stereo is None or (self._has_lenses and self.stereo.is_checked)
        return has_checked and self._light.is_settled

    @property
    def learned(self) -> Learned:
        """What it has learned of the light, for `resume`."""
        return self._light.learned

    def resume(self, learned: Learned) -> None:
        """Go on where another stitcher of the rig, that had settled, was."""
        self._has_lenses = True
        if self.stereo is not None:
            self.stereo.is_checked = True
        self._light.resume(learned)

    def _find_range(self, images: Mapping[str, Bytes]) -> list[Ranged]:
        """Return what the images say about range."""
        if self.stereo is None:
            return []
        grays = _to_grays(images)
        found = self.stereo.find(grays)  # names exchanged levels, before lenses are blamed for them
        if not self._has_lenses:
            check_lenses(self.rig, grays)
            self._has_lenses = True
        return found

    def _project_depths(self, depths: Mapping[str, NDArray[np.floating]]) -> list[Ranged]:
        for name, depth_m in depths.items():
            check_depth(depth_m, self.rig.camera(name).camera, f"{name}: depth")
        views, fusion = self.layouts.views, self.params.fusion
        return [range_from_depth(depth_m, views[name], self.whole, fusion) for name, depth_m in depths.items()]

    def _project_points(self, points_rig: NDArray[np.floating] | None) -> list[Ranged]:
        if points_rig is None:
            return []
        return [range_from_cloud(self._to_sphere(points_rig), self.whole)]

    def _to_sphere(self, points_rig: NDArray[np.floating]) -> Array:
        return self.T_rig_sphere.inverse().apply(np.asarray(points_rig, dtype=np.float64))


def _to_grays(images: Mapping[str, Bytes]) -> dict[str, Bytes]:
    """Return grey images (h, w) of grey or RGB ones."""
    return {name: to_gray_bytes(image) for name, image in images.items()}
