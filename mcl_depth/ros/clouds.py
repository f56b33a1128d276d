"""Where the geometry comes from: a file, a map of our own, the topic `cloud`, or the call load_cloud."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2
from sphere_nav_msgs.srv import LoadCloud

from mcl_depth.filter import Filter
from mcl_depth.geometry.area import limits_of
from mcl_depth.geometry.cloud import Geometry, cloud_from_points, means_of
from mcl_depth.geometry.files import TILE_ENDINGS, read_geometry
from mcl_depth.geometry.geodetic import Degrees, declared_crs, degrees_of
from mcl_depth.geometry.survey_frame import refuse_stray
from mcl_depth.params import MclDepthParams
from mcl_depth.site import Site
from mcl_depth.status import REMEDIES
from sphere_nav.geometry import Camera
from sphere_nav.localization.status import FINE, BaseEstimate, Reason, State, Status, Verdict, status_of
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.conversions.driving import check_frames
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.service import one_line

MADE_AT_ONCE = 512  # depth images that an image waits for: about a second
WAIT = "wait; cache.folder keeps it for the next start"
NO_CLOUD = "set `cloud`, call ~/load_cloud, or publish the topic cloud"
STEP = 2  # every second pixel of every second row of a sphere becomes a point


class GeometryLoader:
    """The geometry in force, and the parameters that go with it. What cannot be used changes nothing."""

    def __init__(self, endpoints: Endpoints, params: MclDepthParams, on_change: Callable[[], None]) -> None:
        """Read the file of the parameter; ValueError or OSError where it cannot be. `on_change`: use another filter."""
        self._log, self._on_change, self._declared = endpoints.log, on_change, params
        self.geometry: Geometry | None = None
        self.params = params  # with the spacing of the last call
        self.fault = FINE  # nothing can be compared with the geometry
        self._site: Site | None = None
        self._share = 1.0  # of its depth images that are made
        self._origin = endpoints.add_publisher("map_origin", PointStamped, qos.LATCHED)
        self._fix = endpoints.add_publisher("fix", NavSatFix, qos.STATE) if params.survey.crs else None
        self._degrees_of: Degrees | None = None  # by the survey's system, where it is known
        if params.cloud:
            self.use(read_map(params.cloud, params))
        endpoints.add_service("~/load_cloud", LoadCloud, self.on_load_cloud)
        endpoints.add_subscription("cloud", PointCloud2, self.on_cloud, qos.LATCHED, is_required=False, silence=0.0)

    def use(self, geometry: Geometry, voxel_m: float = 0.0) -> None:
        """Use another geometry, thinned to `voxel_m`, or as the parameter says where that is 0."""
        self._degrees_of = self._find_system(geometry.name)
        synthesis = self._declared.synthesis
        voxel_m = voxel_m or synthesis.voxel_m
        self.geometry, self.fault = geometry, FINE
        self._site, self._share = None, 1.0
        self.params = replace(self._declared, synthesis=replace(synthesis, voxel_m=voxel_m))
        self._on_change()
        message = PointStamped()
        message.header.frame_id = self._declared.map_frame
        message.point.x, message.point.y, message.point.z = geometry.origin
        self._origin.publish(message)
        for warning in geometry.warnings:
            self._log.warning(warning)

    def _find_system(self, name: str) -> Degrees | None:
        told = self._declared.survey.crs
        if told != "auto":
            return degrees_of(told) if told else None
        crs = declared_crs(Path(name))
        if crs is not None and crs.is_projected:
            return degrees_of(crs)
        self._log.warning(f"{name}: expected a declared system of coordinates for fix, found none: set survey.crs")
        return None

    def tell_fix(self, estimate: BaseEstimate, stamp_ns: int) -> None:
        """Publish where on Earth a pose of the base is; its height is that of the survey."""
        pose, covariance = estimate.T_map_base, estimate.covariance
        if self._fix is None or self._degrees_of is None or self.geometry is None or pose is None or covariance is None:
            return
        east, north, height = pose.translation + self.geometry.origin
        latitude, longitude = self._degrees_of(east, north)
        full = np.reshape(conversions.to_ros_covariance(covariance, pose), (6, 6))
        message = NavSatFix(
            header=conversions.header(stamp_ns, self._declared.base_frame),
            status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=0),  # no satellites
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=float(height),
            position_covariance=full[:3, :3].ravel().tolist(),
            position_covariance_type=NavSatFix.COVARIANCE_TYPE_KNOWN,
        )
        self._fix.publish(message)

    def make_filter(self, camera: Camera, camera_height: float) -> Filter | None:
        """Return a filter for the geometry, once its map is made ready; before, and where it cannot be used, None.

        Each call makes a part of what is missing, so that an image is answered within a second or two.
        """
        if self.geometry is None or self.fault is not FINE:
            return None
        try:
            if self._site is None:
                self._site = Site(self.geometry, camera, camera_height, self.params, is_ready=False)
                self._log.info(f"map: {len(self._site.grid.positions)} places are made ready")
            self._share = self._site.prepare(None if self.params.every_image else MADE_AT_ONCE)
        except ValueError as error:
            detail = "; ".join([str(error), *self.geometry.warnings])
            self.fault = Verdict(Reason.MAP_ERROR, detail=detail)
            self._log.error(detail)
            return None
        if self._share < 1.0:
            return None
        self._log.info("map: ready")
        return self._site.filter()

    def status(self, stamp: int, fault: Verdict) -> Status:
        """Return what an image is answered with while there is no filter."""
        if self.geometry is None:
            return status_of(State.NO_MAP, stamp, Verdict(Reason.NONE, advice=NO_CLOUD))
        if self.fault is not FINE:
            return status_of(State.NO_MAP, stamp, self.fault, REMEDIES)
        if fault is FINE and self._share < 1.0:
            fault = Verdict(Reason.NO_CONVERGENCE, self._share, 1.0, "share of the map that is made ready", WAIT)
        return status_of(State.SEARCHING, stamp, fault, REMEDIES)

    def on_cloud(self, message: PointCloud2) -> None:
        """Use a cloud in the map's frame; ValueError for one of another frame, or without points."""
        check_frames(message, self._declared.map_frame)
        cloud = cloud_from_points(conversions.message_to_cloud(message), "cloud")
        refuse_stray(cloud.points, cloud.name)
        self.use(cloud)

    def on_load_cloud(self, request: LoadCloud.Request, response: LoadCloud.Response) -> LoadCloud.Response:
        """Use another cloud; one that cannot be read leaves the present one in force, and who asks is told no more."""
        started = time.perf_counter()
        try:
            if not (math.isfinite(request.voxel_size) and request.voxel_size >= 0.0):
                raise ValueError(f"voxel_size: expected 0 m or more, found {request.voxel_size:g}")
            geometry = self._read(request.path)
            voxel_m = request.voxel_size or self._declared.synthesis.voxel_m
            num_points = count_points(geometry, voxel_m)  # before it is in force: thinning may refuse it
            self.use(geometry, request.voxel_size)
        except (ValueError, OSError) as error:
            response.message = one_line(error)
            return response
        assert self.geometry is not None
        response.num_points = num_points
        for corner, values in zip((response.minimum, response.maximum), self.geometry.box, strict=True):
            corner.x, corner.y, corner.z = (float(value) for value in values)
        response.success, response.message = True, f"{response.num_points} points of {request.path}"
        if self.geometry.warnings:
            response.message += f"; {self.geometry.warnings[-1]}"
        response.seconds = time.perf_counter() - started
        return response

    def _read(self, path: str) -> Geometry:
        try:
            return read_map(path, self._declared)
        except (ValueError, OSError) as error:
            self._log.warning(f"load_cloud: {one_line(error)}")
        raise ValueError("path: expected a cloud or map, found none that can be read: the log of mcl_depth says why")


def count_points(geometry: Geometry, voxel_m: float) -> int:
    """Return the number of cubes of a cloud that hold points; of vertices of surfaces."""
    if geometry.is_mesh:
        return len(geometry.points)
    return len(means_of(geometry.points.astype(np.float64), voxel_m, geometry.name))


def read_map(path: str, params: MclDepthParams | None = None) -> Geometry:
    """Return the geometry of a file, of a folder of tiles, or of one of key spheres."""
    params, folder = params or MclDepthParams(), Path(path)
    if not folder.is_dir() or any(file.suffix.lower() in TILE_ENDINGS for file in folder.iterdir()):
        limits, reach = limits_of(params.area.limits), params.synthesis.max_range_m
        return read_geometry(path, params.survey, None if limits is None else limits + reach * np.array([-1, -1, 1, 1]))
    parts = [np.zeros((0, 3), np.float32)]
    with open_map(path) as reader:
        for node in reader.graph:
            points, _ = reader.load_sphere(node.id).points(STEP)
            parts.append(node.T_map_sphere.apply(points).astype(np.float32))
        map_id = str(reader.info.map_id)
    return replace(cloud_from_points(np.concatenate(parts), path), map_id=map_id)
