"""Where the node gets its trajectory from: a file, a nav_msgs/Path, the call load_trajectory."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Path
from sphere_nav_msgs.msg import ReferenceTrajectory
from sphere_nav_msgs.srv import LoadTrajectory

from path_follower.params import PathFollowerParams
from path_follower.path import ReferencePath
from path_follower.path_files import read_path
from path_follower.ros.front import LoopRequests
from path_follower.taught import Given, make_path, taught_speeds, told_headings
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.constants import LOG_PERIOD_S
from sphere_nav.ros.conversions import driving
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.interfaces import from_bytes

MAX_PATH_BYTES = 8_000_000  # of a message: 100,000 poses, which are read for seconds; a file holds ten times as many


class TrajectoryIntake:
    """Gives trajectories to the follower and shows the one in force. What cannot be read changes nothing."""

    def __init__(self, endpoints: Endpoints, params: PathFollowerParams, loop: LoopRequests) -> None:
        """Open topics and the service; load the file where one is set."""
        self.loop, self.log, self._now_ns = loop, endpoints.log, endpoints.now_ns
        self.params = params
        self.path: ReferencePath | None = None
        self.points = np.empty((0, 2))
        self.shown = endpoints.add_publisher("~/trajectory", ReferenceTrajectory, qos.LATCHED)
        endpoints.add_subscription("reference_path", Path, self.read_path, qos.LATCHED, is_required=False, raw=True)
        endpoints.add_service("~/load_trajectory", LoadTrajectory, self.on_load)
        if self.params.trajectory:
            self.path = read_path(self.params.trajectory, self.params)
            self.loop.ask("load", self.path)

    def read_path(self, data: bytes) -> None:
        """Convert a message and use it where the vehicle stands; else it is not even read."""
        if self.loop.ask("is_at_rest"):
            self.on_path(from_bytes(data, Path, MAX_PATH_BYTES))
        else:
            text = "reference_path: not read while the vehicle is under way: call stop first"
            self.log.warning(text, every=LOG_PERIOD_S)

    def tune(self, params: PathFollowerParams) -> None:
        """Make trajectories with other values from now on, and show the one in force."""
        self.params = params
        if self.path is not None:
            self.path = self.path.at_cruise(params.speed.cruise)
        self.show(self.path)

    def on_path(self, message: Path) -> None:
        """Use a nav_msgs/Path; the same path again changes nothing. Increasing stamps give the taught speed."""
        driving.check_frames(message, self.params.map_frame)
        poses = conversions.path_to_poses(message)
        points = np.array([T_map_base.translation[:2] for _, T_map_base in poses]).reshape(-1, 2)
        if len(points) and np.array_equal(points, self.points):
            return
        stamps = np.array([stamp for stamp, _ in poses], dtype=np.int64)
        speeds = taught_speeds(points, stamps) if len(points) > 1 and np.all(np.diff(stamps) > 0) else None
        yaw = told_headings(points, np.array([T_map_base.quaternion for _, T_map_base in poses]).reshape(-1, 4))
        self.use(make_path(Given(points, yaw, speeds), self.params))
        self.points = points

    def on_load(self, request: LoadTrajectory.Request, response: LoadTrajectory.Response) -> LoadTrajectory.Response:
        """Load a file; one that cannot be read leaves the present trajectory in force."""
        if not self.loop.ask("is_at_rest"):
            raise ValueError("path: expected a follower that stands, disarmed: call stop first")
        path = read_path(request.path, self.params)
        self.use(path)
        response.success, response.num_points = True, len(path)
        response.length = path.length
        return response

    def use(self, path: ReferencePath) -> None:
        """Hand a trajectory to the follower, and show it; ValueError where it does not stand."""
        self.loop.ask("load", path)
        self.show(path)

    def show(self, path: ReferencePath | None) -> None:
        """Publish the trajectory that is in force now; say where the car cannot follow it."""
        self.path = path
        if path is None:
            return
        self.shown.publish(driving.trajectory_to_message(path, self._now_ns(), self.params.map_frame))
        sharpest, possible = path.max_curvature, self.params.vehicle.max_curvature
        text = f"trajectory of {path.length:.1f} m"
        if sharpest > possible:
            bend = f"bends to {1 / sharpest:.1f} m radius"
            self.log.warning(f"{text} {bend}: the car cannot turn tighter than {1 / possible:.1f} m")
        else:
            self.log.info(text)
