"""A geometry made ready for the filter: depth images, ground, the area where the vehicle may be, and what suits it."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.joint_evidence import SurveyGrid
from mcl_depth.constants import MESH_STEP, MIN_HEIGHT_M, MIN_SEEN
from mcl_depth.filter import Filter
from mcl_depth.geometry.area import Area, Ground, find_area
from mcl_depth.geometry.cloud import Geometry
from mcl_depth.geometry.mesh import sample_surface
from mcl_depth.geometry.synthesis import DepthSynthesizer, panorama_window
from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.params import FilterParams, SynthesisParams
from sphere_nav.geometry import Camera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build, to_mapping

INDOOR_WIDTH_M = 40.0  # a building is narrower, if not shorter

PRESETS: dict[str, dict[str, Any]] = {
    "indoor": {},  # the defaults
    "outdoor": {
        "cache.max_distance": 0.5,  # what is seen is farther away (N17 table I, column ETHZ)
        "area.step": 0.5,
        "area.min_piece": 400.0,  # the inside of a house is no street
        "synthesis.voxel_m": 0.2,
        "comparison.is_sky_far": True,  # the skyline is the strongest edge
    },
}


def apply_preset(params: FilterParams, box: tuple[NDArray[Any], NDArray[Any]], camera: Camera) -> FilterParams:
    """Return parameters with the preset's values where they are at their defaults, and the likeness for a camera.

    `box` is that of the cloud, m. A panorama in a building is compared by what was learned: nothing else was.
    """
    name = params.preset
    if name == "auto":
        width = float(np.min((box[1] - box[0])[:2]))
        name = "indoor" if width <= INDOOR_WIDTH_M else "outdoor"
    values, defaults = to_mapping(params), to_mapping(type(params)())
    changes = {key: value for key, value in PRESETS[name].items() if values[key] == defaults[key]}
    if values["likeness.kind"] == "auto":
        is_known = name == "indoor" and params.synthesis.num_columns == defaults["synthesis.num_columns"]
        is_learned = is_known and share_seen(camera, params.synthesis) >= MIN_SEEN
        changes["likeness.kind"] = "learned" if is_learned else "gradients"
    return build(type(params), values | changes | {"preset": name})


def share_seen(camera: Camera, params: SynthesisParams) -> float:
    """Return how much of the panoramas that are compared a spherical camera shows, if it is upright; others: 0."""
    window = panorama_window(params)
    return float(camera.project(pixel_rays(window))[1].mean()) if isinstance(camera, Spherical) else 0.0


class Site:
    """What of a map does not change while the filter runs."""

    def __init__(
        self, geometry: Geometry, camera: Camera, camera_height: float, params: FilterParams, *, is_ready: bool = True
    ) -> None:
        """`camera_height` m above the ground, unless the parameter of that name is set.

        `is_ready`: the depth images are made now; else `prepare` has to be called before a filter needs them.
        """
        self.params = params = apply_preset(params, geometry.box, camera)
        height = params.camera_height or camera_height
        if height < MIN_HEIGHT_M:
            expected = "camera_height: expected that of the camera above the ground (or a mounting that tells it)"
            raise ValueError(f"{expected}, {MIN_HEIGHT_M:g} m or more, found {height:g} m")
        points = sample_surface(geometry, MESH_STEP).points if geometry.is_mesh else geometry.points
        name = hashlib.sha256(points.tobytes()).hexdigest()
        self.synthesizer = DepthSynthesizer(geometry, params.synthesis)
        self.depth_map = DepthMap(self.synthesizer, Ground(points).heights, height, params, name)
        self.area: Area = find_area(points, self.depth_map.heights, params.area)
        self.grid = SurveyGrid(self.depth_map, self.area.middles)  # compared with every image
        if is_ready:
            self.prepare()

    def prepare(self, at_most: int | None = None) -> float:
        """Make the depth images that every image is compared with, or at most so many; return the share that is there.

        With `cache.folder` they are kept then: what was made once is read by the next site.
        """
        places = self.grid.positions
        num_missing = self.depth_map.fill(places, at_most)
        if not num_missing:
            self.depth_map.ranges_from(np.array([*places[0], 0.0]))  # no image waits for what draws
        return 1.0 - num_missing / len(places)

    def filter(self) -> Filter:
        """Return a filter that knows nothing yet."""
        return Filter(self.params, self.depth_map, self.area, self.grid)
