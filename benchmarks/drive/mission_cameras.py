"""A drive of the simulator as its node would record it, and where a map that has drifted truly is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.drive.mission_town import STEP_NS, features
from cycab_sim.ros.outputs import Outputs
from cycab_sim.simulator import START_NS, Simulator
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell, record


def record_drive(simulator: Simulator, path: Path, length_m: float = np.inf) -> None:
    """Let the simulator's driver drive, so far at most; write what its node would publish into a bag."""
    bus = OfflineBus(start_ns=START_NS)
    outputs = publish_on(bus, simulator)
    with BagWriter(path) as bag:
        while simulator.driver.distance < length_m and not simulator.is_taught:
            bus.now_ns = simulator.time_ns
            for name in simulator.take_due():
                outputs.publish(name)
            for _ in record(bus.settle(), bag, bus):
                pass
            simulator.step(simulator.teach_command(), STEP_NS // 5)


def publish_on(bus: OfflineBus, simulator: Simulator) -> Outputs:
    """Return the simulator's outputs on a bus; its cameras' places are told."""
    outputs = Outputs(OfflineShell(bus, "cycab_sim", {}, {}), simulator)
    outputs.publish_statics()
    return outputs


class Taught:
    """The tour as it was mapped and as it truly was: what is near it in the map, and where that is in the world."""

    def __init__(self, mapped: Trajectory, truth: Trajectory) -> None:
        at, known = truth.at(mapped.stamps_ns)
        self.T_world, self.T_map = at.T_map_body[known], mapped[known].T_map_body
        x, y, _ = self.T_map.translation.T
        self.tree = cKDTree(features(x, y, np.asarray(self.T_map.yaw)))

    def to_world(self, T_map: SE3) -> SE3:
        """Return where a pose of the map truly is, by the nearest taught pose that heads alike."""
        x, y, _ = T_map.translation
        near = int(self.tree.query(features(x, y, T_map.yaw))[1])
        return self.T_world[near] @ self.T_map[near].inverse() @ T_map
