"""The drives of the papers: the chain of `sphere_nav demo`, and what each experiment does otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from sphere_nav_msgs.msg import SimulationFault
from sphere_nav_msgs.srv import SetFault, Teleport

from benchmarks.papers.plans import planar, turn_around, write_plan
from benchmarks.papers.result import JudgedFigure, write_result
from cycab_sim.params import SimParams
from cycab_sim.world.paths import Path as WorldPath
from cycab_sim.world.traffic.loops import standing_place
from cycab_sim.world.worlds import build_world, geometry_cloud
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory, read_tum, write_tum
from sphere_nav.params import build
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav_tools.cli.demo.demo import BUSY, Demo, has_ended, rms
from sphere_nav_tools.cli.demo.report import DriveErrors, drive_errors, read_truth
from sphere_nav_tools.cli.demo.watch import DriveMonitor

APPROACH = 12.0  # m of the taught path before and after the turn in three moves
JOINED = 10.0  # m along the path after which the car is on it
COVERED_FROM, COVERED_FOR = 15.0, 3.0  # s of simulated time
STANDING_AT = 15.0  # m along the path: on the first straight
PEDESTRIAN_RADIUS = 0.35  # m
ALL_AROUND = {  # a lens for both localisers: half of the sphere
    "camera.model": "fisheye",
    "camera.view_deg": 190.0,
    "camera.size": "416,416",
    "camera.mounting_deg": "0.4,0,1.8,0,0,0",
}
SURVEY_SPACING, SURVEY_MARGIN = 0.2, 30.0  # m between points; m around the path, in which mcl_depth searches
ASIDE = 0.5  # m beside the path at most, of starts and drives that are drawn
NEAR = 1.0  # m from the truth, that is the right place for mcl_depth
CAMERA_X, HEIGHT = 0.4, 1.8  # m before the rear axle, and above the ground, of a panoramic camera
PANORAMA = {"camera.model": "panorama", "camera.size": "360,96", "camera.mounting_deg": f"{CAMERA_X},0,{HEIGHT},0,0,0"}


class PaperDrive(Demo):
    """One experiment: `prepare` teaches and maps, or takes what another one has taught; `run` drives and judges."""

    purpose = ""  # for the user
    route: str = "two_turns"
    world: Mapping[str, Any] = {}  # parameters of both drives
    simulator: Mapping[str, Any] = {}  # of the second drive alone
    offset = (0.0, 0.0)  # m to the left, deg to the left: the car's place at the start
    rmse_bound, max_bound = 0.03, 0.10  # m
    judged_from = 0.0  # m along the path
    reach = np.inf  # m of the taught path that are driven

    def __init__(self, name: str, output: Path, seed: int, domain: int | None, taught: Path | None) -> None:
        """`taught`: output of an experiment of the same seed whose teaching drive and map are used again."""
        super().__init__(output, seed, self.route, domain, self.world, taught=taught)
        self.name, self.seed = name, seed
        self.other_day = self.other_day | dict(self.simulator)
        params = build(SimParams, self.simulation)
        self.path = build_world(params.world, params.seed, params.path).path

    def prepare(self) -> None:
        """Teach and map where that is not done."""
        if self.taught == self.folder:
            self.teach()
            self.map()

    def run(self) -> bool:
        """Drive, judge, write everything; True where every bound is kept."""
        self.prepare()
        self.drive()
        figures, told = self.evaluate()
        more = {"end": self.end, "length_m": self.length, "seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
        return write_result(self.folder, self.name, self.seed, figures, more | dict(told))

    def evaluate(self) -> tuple[list[JudgedFigure], Mapping[str, Any]]:
        """Return what is judged, and what else is told."""
        return self.figures(self.measure()), {}

    def figures(self, errors: DriveErrors) -> list[JudgedFigure]:
        """Return what is judged."""
        lateral = errors.lateral[errors.along >= self.judged_from]
        return [
            JudgedFigure("lateral error, RMSE", rms(lateral), "m", self.rmse_bound),
            JudgedFigure("lateral error, largest", float(np.abs(lateral).max()), "m", self.max_bound),
            JudgedFigure("share of the path that was driven", errors.share_driven, "", 0.95, is_minimum=True),
            JudgedFigure("end of the path reached", float(self.has_finished), "", 1.0, is_minimum=True),
        ]

    def start(self) -> Array:
        """Return x, y, yaw (3,) of the car in the world at the start."""
        return beside(self.path, 0.0, *self.offset)

    def place(self, watch: DriveMonitor) -> None:
        """Put the car where it starts, before time passes."""
        teleport(watch, self.start())

    def reference(self) -> Path:
        """Return the file of the path to drive: the taught one, or its first `reach` m."""
        taught = read_tum(self.taught / "taught.tum")
        if taught.distances[-1] <= self.reach:
            return super().reference()
        write_tum(self.folder / "part.tum", taught[taught.distances <= self.reach])
        return self.folder / "part.tum"

    def errors(self, T_world_map: SE3) -> DriveErrors:
        """Compare with the taught path, or its first `reach` m."""
        truth = read_truth(self.taught / "teach")
        driven = planar(truth[truth.distances <= self.reach])
        return drive_errors(self.taught / "teach", self.folder / "drive", T_world_map, driven)

    def survey(self) -> dict[str, Any]:
        """Write what a surveyor would have: the town as points, without colour; return it as mcl_depth takes it."""
        T_map_world = self.anchor().inverse()
        points = T_map_world.apply(geometry_cloud(self.seed, SURVEY_SPACING, "town"))
        np.save(self.folder / "survey.npy", points.astype(np.float32))
        path = read_tum(self.taught / "taught.tum").positions[:, :2]
        limits = [*(path.min(axis=0) - SURVEY_MARGIN), *(path.max(axis=0) + SURVEY_MARGIN)]
        return {"cloud": str(self.folder / "survey.npy"), "area.limits": ",".join(f"{value:.1f}" for value in limits)}


class TwoTurns(PaperDrive):
    """M15 fig. 17 and 18, begun beside the path."""

    purpose = "100 m with two turns of 90 deg, begun 0.5 m and 10 deg beside the path (M15 fig. 17, 18)"
    offset, judged_from = (0.5, 10.0), JOINED

    def figures(self, errors: DriveErrors) -> list[JudgedFigure]:
        """Add how far the car went off while it joined the path."""
        joining = np.abs(errors.lateral[errors.along < JOINED])
        worst = JudgedFigure(
            f"largest distance within the first {JOINED:g} m", float(joining.max()), "m", 1.2 * self.offset[0]
        )
        return [*super().figures(errors), worst]


class Tour(PaperDrive):
    """M15 fig. 19."""

    purpose = "490 m of a city, over a square and through a lane, in traffic and other light (M15 fig. 19)"
    route, world = "tour", BUSY
    max_bound = 0.15


class Square(PaperDrive):
    """M15 section 6.4.5: far houses tell little of where the car is, and shadows are elsewhere."""

    purpose = "60 m over an open square, houses further than 60 m, in shadows of three hours later (M15 6.4.5)"
    world: Mapping[str, Any] = {"world": "square", "light.sun": "172,9h"}
    simulator: Mapping[str, Any] = {"light.sun": "172,12h"}
    rmse_bound = max_bound = 0.05

    def figures(self, errors: DriveErrors) -> list[JudgedFigure]:
        """Allow that the drive ends where the localiser withholds the pose."""
        is_withheld = not self.has_finished and "localiser TRACKING" not in self.end
        kept = super().figures(errors)[:2]
        told = [
            JudgedFigure("share of the path that was driven", errors.share_driven),
            JudgedFigure("end reached, or pose withheld", float(self.has_finished or is_withheld), "", 1.0, True),
        ]
        return [*kept, *told]


class Reverse(PaperDrive):
    """Taught forward, driven back in reverse gear: the camera still looks ahead (M15 fig. 14)."""

    purpose = "taught forward, driven back in reverse gear by the same camera (M15 fig. 14)"
    rmse_bound = max_bound = 0.08

    def start(self) -> Array:
        """Return where the teaching drive ended."""
        return planar(read_truth(self.taught / "teach"))[-1]

    def reference(self) -> Path:
        """Return the taught poses from the last to the first."""
        taught = read_tum(self.taught / "taught.tum")
        back = Trajectory((taught.stamps_ns[-1] - taught.stamps_ns)[::-1].copy(), SE3(taught.T_map_body.matrix[::-1]))
        write_tum(self.folder / "reverse.tum", back)
        return self.folder / "reverse.tum"

    def errors(self, T_world_map: SE3) -> DriveErrors:
        """Compare with the teaching drive turned round."""
        path = planar(read_truth(self.taught / "teach"))[::-1]
        return drive_errors(self.taught / "teach", self.folder / "drive", T_world_map, path)


class ThreePointTurn(PaperDrive):
    """To the crossing, a turn in three moves there, and back: nothing of the turn was taught."""

    purpose = "to the crossing, a turn in three moves there, and home (M15 fig. 14)"
    rmse_bound = max_bound = 0.08

    def _poses(self) -> tuple[Array, Array]:
        """Return the last `APPROACH` m of taught poses (N, 3) before it: in the world, by the truth, and in the map."""
        truth, taught = read_truth(self.taught / "teach"), read_tum(self.taught / "taught.tum")
        at, known = truth.at(np.maximum(taught.stamps_ns, truth.stamps_ns[0]))
        end = self.path.pieces[0].length
        part = (at.distances >= end - APPROACH) & (at.distances <= end)
        return planar(at)[part], planar(taught[known])[part]

    def start(self) -> Array:
        """Return where the plan begins."""
        return self._poses()[0][0]

    def reference(self) -> Path:
        """Return the plan in the map."""
        return write_plan(self.folder / "plan.csv", *turn_around(self._poses()[1]))

    def errors(self, T_world_map: SE3) -> DriveErrors:
        """Compare with the plan in the world, beside where the teaching drive truly was."""
        path, _ = turn_around(self._poses()[0])
        return drive_errors(self.taught / "teach", self.folder / "drive", T_world_map, path)


class Blind(PaperDrive):
    """The camera is covered for three seconds; the car has to stand, to find itself again, and to drive on."""

    purpose = "the camera is covered for three seconds on the way"
    reach = 35.0

    def place(self, watch: DriveMonitor) -> None:
        """Plan the cover, too."""
        super().place(watch)
        fault = SimulationFault(target="camera", kind="exposure", start=COVERED_FROM, duration=COVERED_FOR)
        watch.call("cycab_sim/set_fault", SetFault.Request(fault=fault))

    def accompany(self, watch: DriveMonitor) -> None:
        """Start again once the localiser has found the place."""
        super().accompany(watch)
        watch.wait("place found again", lambda: watch.localizer.startswith("TRACKING"), is_moving=False)
        watch.insist("path_follower/start")
        watch.wait("start", lambda: watch.follower.startswith(("DRIVING", "SLOW")), is_moving=False)
        self.follow(watch, "drive on", lambda: has_ended(watch.follower))

    def figures(self, errors: DriveErrors) -> list[JudgedFigure]:
        """Add how long the car was driven blind."""
        stamps, speeds = read_speeds(self.folder / "drive")
        begin = COVERED_FROM * 1e9
        zero = stamps[(stamps >= begin) & (speeds == 0.0)]
        late = (zero[0] - begin) / 1e9 if len(zero) else np.inf
        told = [
            JudgedFigure(
                "speed commanded when the camera is covered", float(speeds[stamps < begin][-1]), "m/s", 0.5, True
            ),
            JudgedFigure("zero commanded after the cover", float(late), "s", 0.5),
        ]
        return [*super().figures(errors), *told]


class Pedestrian(PaperDrive):
    """Somebody stands in the way, seen by a laser scanner; the drive ends there."""

    purpose = "somebody stands in the way"
    reach = 30.0

    simulator: Mapping[str, Any] = {"scan.is_on": True, "traffic.standing_at": STANDING_AT}
    follower: Mapping[str, Any] = {"safety.is_scan_required": True}

    def figures(self, errors: DriveErrors) -> list[JudgedFigure]:
        """Return how much room is left."""
        x, y = standing_place(self.path, STANDING_AT).points[0]
        params = build(SimParams, self.simulation).vehicle
        truth = planar(read_truth(self.folder / "drive"))
        gap = room_around(truth, np.array([x, y]), params.front, params.rear, params.width) - PEDESTRIAN_RADIUS
        has_seen = self.end.count("OBSTACLE")
        return [
            JudgedFigure("least room between car and pedestrian", float(gap.min()), "m", 0.5, is_minimum=True),
            JudgedFigure("room when it stands", float(gap[-1]), "m"),
            JudgedFigure("stopped for an obstacle", float(has_seen > 0), "", 1.0, is_minimum=True),
            JudgedFigure("lateral error, RMSE", rms(errors.lateral), "m", self.rmse_bound),
        ]


def beside(path: WorldPath, along: float, left: float, turned_deg: float) -> Array:
    """Return the pose (3,) m, rad that is so far along a path, `left` m beside it and turned to the left."""
    x, y, yaw, _ = path.at(along)
    return np.array([x - left * np.sin(yaw), y + left * np.cos(yaw), yaw + np.radians(turned_deg)])


def teleport(watch: DriveMonitor, pose: Array) -> None:
    """Put the car at a pose (3,) m, rad in the world."""
    x, y, yaw = map(float, pose)
    there = Pose(position=Point(x=x, y=y), orientation=Quaternion(z=np.sin(yaw / 2), w=np.cos(yaw / 2)))
    watch.call("cycab_sim/teleport", Teleport.Request(pose=there))


def room_around(poses: Array, point: Array, front: float, rear: float, width: float) -> Array:
    """Return the distance (N,) m of a point (2,) from the body of a car at poses (N, 3)."""
    off = point - poses[:, :2]
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    along, across = off[:, 0] * cosine + off[:, 1] * sine, off[:, 1] * cosine - off[:, 0] * sine
    beyond = np.maximum(np.maximum(along - front, -rear - along), 0.0)
    return np.hypot(beyond, np.maximum(np.abs(across) - width / 2, 0.0))


def read_speeds(bag: Path) -> tuple[Array, Array]:
    """Return stamps (N,) ns and commanded speeds (N,) m/s of a drive, in order."""
    with BagReader(bag) as reader:
        found = sorted((stamp_ns(m), m.twist.linear.x) for _, _, m in reader.messages(["/cmd_vel"]))
    return np.array([stamp for stamp, _ in found]), np.array([speed for _, speed in found])


DRIVES: Mapping[str, type[PaperDrive]] = {
    "two_turns": TwoTurns,
    "reverse": Reverse,
    "three_point_turn": ThreePointTurn,
    "blind": Blind,
    "pedestrian": Pedestrian,
    "tour": Tour,
    "square": Square,
}
