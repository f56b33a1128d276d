"""The node `path_follower`: poses and a path in, commands out; every pose is answered by a command.

Parameters, services, paths and files are here; the commands come from its control loop (`control.py`).
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial

from sphere_nav_msgs.srv import Drive
from std_srvs.srv import Trigger

from path_follower.params import PathFollowerParams
from path_follower.path_files import read_path
from path_follower.ros.control import ControlLoop
from path_follower.ros.front import FrontNode, LoopEnded
from path_follower.ros.loop_process import run_with_loop
from path_follower.ros.trajectory import TrajectoryIntake
from sphere_nav.ros.tf import TransformError, TransformListener

CALLS = ("start", "stop", "pause", "resume")  # of an operator
PLACE_PERIOD = 0.2  # s between two looks where the scanner is mounted


class PathFollowerNode(FrontNode):
    """What is asked of the follower, checked and finished before it goes to the loop."""

    NAME = "path_follower"
    PARAMS = PathFollowerParams
    LOOP_CLASS = ControlLoop
    params: PathFollowerParams

    def configure(self) -> None:
        """Open topics and services; load the trajectory file where one is set."""
        self.transforms = TransformListener(self.endpoints)
        super().configure()
        self.trajectories: TrajectoryIntake | None = None
        if self.params.source != "homing":
            self.trajectories = TrajectoryIntake(self.endpoints, self.params, self.loop)
        for name in CALLS:
            self.endpoints.add_service(f"~/{name}", Trigger, partial(self.on_call, name))
        self.endpoints.add_service("~/drive", Drive, self.on_drive)
        self.add_timer(PLACE_PERIOD, self.on_place, is_wall=True)

    def activate(self) -> None:
        """Show the trajectory that was loaded at the start."""
        super().activate()
        if self.trajectories is not None:
            self.trajectories.show(self.trajectories.path)

    def tune(self, params: PathFollowerParams) -> None:
        """Drive on with another cruise speed and other limits."""
        self.params = params
        self.loop.ask("tune", params)
        if self.trajectories is not None:
            self.trajectories.tune(params)

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
        if response.success and path is not None and self.trajectories is not None:
            self.trajectories.show(path)
        return response

    def on_place(self) -> None:
        """Tell the loop where its scanner is mounted, once there is one and /tf knows that."""
        with suppress(LoopEnded):
            if frame := self.loop.ask("scan_frame"):
                with suppress(TransformError):
                    T_base_scan = self.transforms.lookup(self.params.base_frame, frame)
                    self.loop.ask("place_scanner", frame, T_base_scan)


def main() -> int:
    """Run the node."""
    return run_with_loop(PathFollowerNode)
