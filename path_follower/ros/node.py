"""The node `path_follower`: poses and a path in, commands out; every pose is answered by a command.

Parameters, services, paths and files are here; the commands come from its control loop (`control.py`).
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import numpy as np
from nav_msgs.msg import Path
from sphere_nav_msgs.msg import ReferenceTrajectory
from sphere_nav_msgs.srv import Drive, LoadTrajectory
from std_srvs.srv import Trigger

from path_follower.params import PathFollowerParams
from path_follower.path import ReferencePath
from path_follower.path_files import read_path
from path_follower.ros.control import ControlLoop
from path_follower.ros.front import FrontNode, LoopEnded
from path_follower.ros.loop_process import run_with_loop
from path_follower.taught import Given, make_path, taught_speeds, told_headings
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.constants import LOG_PERIOD_S
from sphere_nav.ros.conversions import driving
from sphere_nav.ros.interfaces import from_bytes
from sphere_nav.ros.tf import TransformError, TransformListener

CALLS = ("start", "stop", "pause", "resume")  # of an operator
PLACE_PERIOD = 0.2  # s between two looks where the scanner is mounted
MAX_PATH_BYTES = 8_000_000  # of a message: 100,000 poses, which are read for seconds; a file holds ten times as many


class PathFollowerNode(FrontNode):
    """What is asked of the follower, checked and finished before it goes to the loop.

    A trajectory comes from a file, a nav_msgs/Path or a call; one that cannot be read changes nothing.
    """

    NAME = "path_follower"
    PARAMS = PathFollowerParams
    LOOP_CLASS = ControlLoop
    params: PathFollowerParams

    def configure(self) -> None:
        """Open topics and services; load the trajectory file where one is set."""
        self.transforms = TransformListener(self.endpoints)
        super().configure()
        self.path: ReferencePath | None = None  # the one in force
        self.points = np.empty((0, 2))  # of the last message
        for name in CALLS:
            self.add_service(f"~/{name}", Trigger, partial(self.on_call, name))
        self.add_service("~/drive", Drive, self.on_drive)
        self.add_timer(PLACE_PERIOD, self.on_place, is_wall=True)
        if self.params.source == "homing":
            return
        self.shown = self.add_publisher("~/trajectory", ReferenceTrajectory, qos.LATCHED)
        self.add_subscription("reference_path", Path, self.read_path, qos.LATCHED, is_required=False, raw=True)
        self.add_service("~/load_trajectory", LoadTrajectory, self.on_load)
        if self.params.trajectory:
            self.path = read_path(self.params.trajectory, self.params)
            self.loop.ask("load", self.path)

    def activate(self) -> None:
        """Show the trajectory that was loaded at the start."""
        super().activate()
        self.show(self.path)

    def tune(self, params: PathFollowerParams) -> None:
        """Drive on with another cruise speed and other limits; show the trajectory as it is driven now."""
        self.params = params
        self.loop.ask("tune", params)
        self.show(None if self.path is None else self.path.at_cruise(params.speed.cruise))

    def on_call(self, name: str, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Do what an operator asks for; the answer says why not."""
        response.message = self.loop.ask(name)
        response.success = not response.message
        return response

    def on_drive(self, request: Drive.Request, response: Drive.Response) -> Drive.Response:
        """Do what a mission asks for, under the permission that it knows of."""
        path = read_path(request.path, self.params) if request.request == "load" else None
        response.message, response.permission = self.loop.ask("drive", request.request, request.permission, path)
        response.success = not response.message
        if response.success and path is not None:
            self.show(path)
        return response

    def on_place(self) -> None:
        """Tell the loop where its scanner is mounted, once there is one and /tf knows that."""
        with suppress(LoopEnded):
            if frame := self.loop.ask("scan_frame"):
                with suppress(TransformError):
                    T_base_scan = self.transforms.lookup(self.params.base_frame, frame)
                    self.loop.ask("place_scanner", frame, T_base_scan)

    # --- trajectories
    def read_path(self, data: bytes) -> None:
        """Convert a message and use it where the vehicle stands; else it is not even read."""
        if self.loop.ask("is_at_rest"):
            self.on_path(from_bytes(data, Path, MAX_PATH_BYTES))
        else:
            text = "reference_path: not read while the vehicle is under way: call stop first"
            self.log.warning(text, every=LOG_PERIOD_S)

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
        response.success, response.num_points, response.length = True, len(path), path.length
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
        self.shown.publish(driving.trajectory_to_message(path, self.now_ns(), self.params.map_frame))
        sharpest, possible = path.max_curvature, self.params.vehicle.max_curvature
        text = f"trajectory of {path.length:.1f} m"
        if sharpest > possible:
            bend = f"bends to {1 / sharpest:.1f} m radius"
            self.log.warning(f"{text} {bend}: the car cannot turn tighter than {1 / possible:.1f} m")
        else:
            self.log.info(text)


def main() -> int:
    """Run the node."""
    return run_with_loop(PathFollowerNode)
