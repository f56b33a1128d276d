"""A network of taught paths in a simulated city, with the nodes that drive over it, a car, and who walks before it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast
from unittest.mock import Mock

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.action import Navigate
from tf2_msgs.msg import TFMessage

from benchmarks.drive.street import rounded_way
from cycab_sim.params import ActuatorParams, CarParams
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState
from path_follower.path import Pose2
from path_follower.ros.navigator_node import RouteNavigator
from path_follower.ros.node import PathFollowerNode
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Curve, Network, Spot
from path_follower.routes.network_file import write_network
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell
from sphere_nav.ros.conversions import header, se3_to_pose_with_covariance, se3_to_transform, status_to_message

CRUISE = 2.0  # m/s
RIGHT = 1.75  # m to the right of the middle of a street
SOUTH, NORTH = -RIGHT, 110.0 + RIGHT  # y of the streets A eastwards and B westwards
EAST, LANE, NORTH_SIDE = 132.5, 120.0, 42.0  # m: x of the other way over the square, x of the lane, y where they meet
WEST, F_NORTH, F_SOUTH = -20.0 - RIGHT, 40.0 + RIGHT, 40.0 - RIGHT
TOUR: tuple[tuple[float, float], ...] = (
    # A, F, B, C; A, the square, the lane, B
    *((0.0, SOUTH), (F_NORTH, SOUTH), (F_NORTH, NORTH), (WEST, NORTH), (WEST, SOUTH)),
    *((LANE, SOUTH), (LANE, NORTH)),
    # F southwards, the block the other way round, the other way over the square, B westwards
    *((F_SOUTH, NORTH), (F_SOUTH, -SOUTH)),
    *((-20.0 + RIGHT, -SOUTH), (-20.0 + RIGHT, 110.0 - RIGHT), (F_SOUTH, 110.0 - RIGHT), (F_SOUTH, SOUTH)),
    *((EAST, SOUTH), (EAST, NORTH_SIDE), (LANE, NORTH_SIDE), (LANE, NORTH)),
    (20.0, NORTH),
)
PLACES = {"square": (100.0, SOUTH), "lane": (120.0, 60.0), "market": (80.0, NORTH)}
PLACES |= {"church": (-20.0 - RIGHT, 60.0), "gate": (40.0 + RIGHT, 60.0), "school": (40.0 - RIGHT, 60.0)}
NOISE = (0.01, 0.01, 0.003)  # m, m, rad of a pose
PERIOD_NS, LATENCY_NS, STEP_NS = 100_000_000, 50_000_000, 50_000_000
SETTLE = 10  # steps in which the nodes hear of each other
PATIENCE = 900.0  # s of simulated time for a mission
WALKER, STAYING = 0.3, 4.0  # m radius; s before the car
BEAMS, SCAN_RANGE = 121, 20.0
COVARIANCE = 1e-4 * np.eye(6)


@dataclass
class Driven:
    """What became of a mission."""

    start: str
    goal: str
    is_arrived: bool = False
    reason: str = ""
    distance: float = 0.0
    contacts: int = 0
    stops: int = 0  # at joints, for no reason
    lateral: list[float] = field(default_factory=list)


class Town:
    """The network, the nodes, the car, and who walks before it."""

    def __init__(self, folder: Path, seed: int, network: Network | None = None) -> None:
        self.rng = np.random.default_rng(seed)
        self.network = network or tour_network()
        self.length = sum(edge.length for edge in self.network.edges.values())
        write_network(folder / "city.geojson", self.network)
        self.bus = OfflineBus(start_ns=1_000_000_000)
        cruise = {"speed.cruise": CRUISE, "enable_stamped_cmd_vel": True}
        self.follower = self.bus.add(PathFollowerNode, cruise)
        values = {"network": str(folder / "city.geojson"), "mission.memory": 60.0}
        self.navigator = self.bus.add(RouteNavigator, values | {"mission.cruise": CRUISE})
        self.shell = cast("OfflineShell", self.navigator.endpoints)
        mounted = se3_to_transform(SE3.identity(), self.bus.now_ns, "base_link", "scan")
        self.bus.publish("/tf_static", TFMessage(transforms=[mounted]))
        self.here = "square"
        self.car = Vehicle(VehicleState(*self._spot(self.here)), CarParams(), ActuatorParams())
        self.command = VehicleCommand()
        self.pending: list[tuple[int, Pose2]] = []
        self.walkers: list[tuple[Array, int]] = []  # where, and until when
        self.next_walker, self.is_standing = 0.0, True
        curves = [edge.curve for edge in self.network.edges.values()]
        points = [pose for curve in curves for pose in zip(curve.x, curve.y, curve.yaw, strict=True)]
        self.points = np.array([self.placed(Pose2(*pose)) for pose in points])
        self.tree = cKDTree(features(*self.points.T))

    def _spot(self, place: str) -> Pose2:
        return self.network.nodes[self.network.places[place]]

    # --- a mission
    def drive(self) -> Driven:
        """Drive to another place."""
        goals = [name for name in PLACES if name in self.network.places and name != self.here]
        driven = Driven(self.here, str(self.rng.choice(goals)))
        self.pause(SETTLE)
        check, begin, _ = self.shell.actions["navigate"]
        asked = Mock(request=Navigate.Goal(place=driven.goal))  # a goal as a client of the action sees it
        check(asked.request)
        begin(asked)
        end = self.bus.now_ns + round(PATIENCE * 1e9)
        while not asked.finish.called and self.bus.now_ns < end:
            self.step(driven, may_walk=True)
        self.walkers = []
        driven.reason = f"still {self.navigator.mission.state}: {self.navigator.mission.reason}"
        for result in asked.finish.call_args.args if asked.finish.called else ():
            driven.is_arrived, driven.reason, driven.distance = result.success, result.reason, result.distance
        if driven.is_arrived:
            self.here = driven.goal
            return driven
        self.pause(200)  # else the car is brought to a place by hand
        self.follower.loop.ask("stop")
        self.here = "church"
        self.put(self._spot(self.here))
        return driven

    def pause(self, count: int) -> None:
        """Let so many steps pass between missions."""
        for _ in range(count):
            self.step(Driven("", ""), may_walk=False)

    def placed(self, pose: Pose2) -> Pose2:
        """Return where a pose of the network truly is."""
        return pose

    def put(self, pose: Pose2) -> None:
        """Put the car down, and let the nodes see it there."""
        self.car.state = VehicleState(*pose)
        self.pause(40)

    # --- time
    def step(self, driven: Driven, *, may_walk: bool) -> None:
        """Let 50 ms pass: the nodes hear what is measured now, the car obeys the last command."""
        now = self.bus.now_ns + STEP_NS
        for record in self.sense(now):
            if record.topic == "/cmd_vel":
                self.command = VehicleCommand(record.message.twist.linear.x, record.message.twist.angular.z)
        self.move()
        if may_walk:
            self._walk(now)
        self.walkers = [walker for walker in self.walkers if walker[1] > now]
        self._measure(driven)

    def sense(self, now: int) -> Iterator[Recorded]:
        """Let time pass; publish a pose every second time, with a scan; yield what is said."""
        yield from self.bus.advance(now)
        if now % PERIOD_NS == 0:
            state = self.car.state
            noisy = Pose2(*(np.array((state.x, state.y, state.yaw)) + self.rng.normal(size=3) * NOISE))
            self.pending.append((now, noisy))
        while self.pending and self.pending[0][0] <= now - LATENCY_NS:
            stamp, pose = self.pending.pop(0)
            self.bus.publish("/status", status_to_message(Status(State.TRACKING), stamp, "map"))
            self.bus.publish("/pose", se3_to_pose_with_covariance(SE3.from_planar(*pose), COVARIANCE, stamp, "map"))
            self.bus.publish("/scan", self.scan(stamp))
            yield from self.bus.settle()

    def move(self) -> None:
        """Let the car obey for a step."""
        for _ in range(5):
            self.car.step(self.command, STEP_NS / 5e9)

    def _walk(self, now: int) -> None:
        """Let somebody step before the car every 150 m of a mission, and off again."""
        mission = self.navigator.mission
        if mission.progress < 5.0:
            self.next_walker = float(self.rng.uniform(50.0, 150.0))
        elif mission.state == "DRIVING" and mission.progress > self.next_walker and mission.distance_remaining > 15.0:
            state = self.car.state
            ahead = 6.0 + 0.5 * self.rng.uniform()
            at = np.array([state.x + ahead * math.cos(state.yaw), state.y + ahead * math.sin(state.yaw)])
            self.walkers.append((at, now + round(STAYING * 1e9)))
            self.next_walker = mission.progress + 150.0

    def scan(self, stamp: int) -> LaserScan:
        """Return what a scanner at the rear axle sees of who stands around."""
        angles = np.linspace(-np.pi / 2, np.pi / 2, BEAMS)
        ranges = np.full(BEAMS, np.inf)
        state = self.car.state
        for at, _ in self.walkers:
            dx, dy = at - (state.x, state.y)
            distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx) - state.yaw
            off = np.abs((angles - bearing + np.pi) % (2 * np.pi) - np.pi)
            hit = (distance * np.sin(np.minimum(off, 1.5)) < WALKER) & (off < 1.5) & (distance < SCAN_RANGE)
            ranges[hit] = np.minimum(ranges[hit], max(distance - WALKER, 0.05))
        return LaserScan(
            header=header(stamp, "scan"), angle_min=-np.pi / 2, angle_max=np.pi / 2,
            angle_increment=np.pi / (BEAMS - 1), range_min=0.01, range_max=SCAN_RANGE, ranges=ranges.tolist(),
        )  # fmt: skip

    def _measure(self, driven: Driven) -> None:
        state, mission = self.car.state, self.navigator.mission
        for at, _ in self.walkers:
            dx, dy = at - (state.x, state.y)
            along = math.cos(state.yaw) * dx + math.sin(state.yaw) * dy
            across = math.cos(state.yaw) * dy - math.sin(state.yaw) * dx
            is_touched = -0.35 - WALKER < along < 1.55 + WALKER and abs(across) < 0.6 + WALKER
            driven.contacts += int(is_touched and abs(state.speed) > 0.02)
        is_under_way = mission.progress >= 10.0
        had_stood, self.is_standing = self.is_standing, not is_under_way or abs(state.speed) < 0.05
        if not self.is_standing:
            x, y, yaw = self.points[self.tree.query(features(state.x, state.y, state.yaw))[1]]
            driven.lateral.append(math.cos(yaw) * (state.y - y) - math.sin(yaw) * (state.x - x))
        elif is_under_way and not had_stood and mission.state == "DRIVING" and not mission.reason:
            driven.stops += mission.distance_remaining > 1.0  # that no walker explains


# --- the network
def features(x: ArrayLike, y: ArrayLike, yaw: ArrayLike) -> Array:
    """Return (..., 4) in which poses are near that are near and head alike."""
    return np.stack([x, y, 2.0 * np.cos(yaw), 2.0 * np.sin(yaw)], axis=-1)


def tour_network() -> Network:
    """Return the network of the tour as it was meant."""
    way = rounded_way(TOUR)
    x, y, yaw, _ = way.at(np.arange(0.0, way.length, 0.1)).T
    return named(build_network([TaughtDrive(Curve(x, y, np.unwrap(yaw), np.full(len(x), CRUISE)))], "city"))


def named(network: Network) -> Network:
    """Return a network with those of the places that are on it."""
    for name, at in PLACES.items():
        spots = []
        for edge in network.edges.values():
            off = np.hypot(edge.curve.x - at[0], edge.curve.y - at[1])
            spots.append(Spot(edge.id, float(edge.curve.arc[int(np.argmin(off))]), float(off.min())))
        nearest = min(spots, key=lambda spot: spot.left)
        network = network.with_place(name, nearest) if nearest.left < RIGHT else network
    return network
