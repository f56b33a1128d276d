"""A geometry made ready for the filter: depth images, ground, and the area where the vehicle may be."""

from __future__ import annotations

import copy
import hashlib

from mcl_depth.belief.survey_grid import SurveyGrid
from mcl_depth.filter import Filter
from mcl_depth.geometry.area import Area, find_area
from mcl_depth.geometry.cloud import Cloud
from mcl_depth.geometry.ground import Ground
from mcl_depth.geometry.mesh import TriangleMesh, sample_surface
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.params import FilterParams
from mcl_depth.presets import apply_preset

SPACING = 0.15  # of the points that stand for a mesh in ground and area, m


class Site:
    """What of a map does not change while the filter runs."""

    def __init__(self, geometry: Cloud | TriangleMesh, camera_height: float, params: FilterParams) -> None:
        """`camera_height` m above the ground, unless the parameter of that name is set; all depth images are made."""
        params = apply_preset(params, geometry.box)
        points = sample_surface(geometry, SPACING).points if isinstance(geometry, TriangleMesh) else geometry.points
        self._name = hashlib.sha256(points.tobytes()).hexdigest()
        self.synthesizer, self._ground = DepthSynthesizer(geometry, params.synthesis), Ground(points)
        self._height = params.camera_height or camera_height
        self.params = params
        self.depth_map = self._depth_map()
        self.area: Area = find_area(points, self.depth_map.heights, params.area)
        self.prepare()

    def prepare(self) -> None:
        """Make the depth images that every image is compared with, and keep them on disk where a folder is set."""
        positions = SurveyGrid(self.depth_map, self.area.middles).positions
        if self.depth_map.fill(positions):
            self.depth_map.save()
        self.depth_map.matched_filter(positions)

    def under(self, params: FilterParams) -> Site:
        """Return the same geometry and area, nothing in the caches; synthesis, area and height stay as they are."""
        other = copy.copy(self)
        other.params = params
        other.depth_map = other._depth_map()
        return other

    def _depth_map(self) -> DepthMap:
        return DepthMap(self.synthesizer, self._ground.heights, self._height, self.params, self._name)

    def filter(self) -> Filter:
        """Return a filter that knows nothing yet."""
        return Filter(self.params, self.depth_map, self.area)
