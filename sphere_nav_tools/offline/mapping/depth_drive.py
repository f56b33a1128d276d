"""What a mapped drive says about where the depth camera of an RGB-D camera sits beside the image's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rig_calibration.constants import FALSE_ALARM
from rig_calibration.drive.depth_pair import DepthFrame, DepthPair
from rig_calibration.drive.depth_pixels import make_frame, without_hidden
from rig_calibration.drive.depth_pose import MIN_PAIRS, NAMES, RefinedDepth, refine_depth_pose
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import Intake
from sphere_mapping.ros.rgbd_intake import RgbdInstant
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, to_gray_bytes
from sphere_nav_tools.offline.constants import DEPTH_LEVELS, MAX_TURN, NUM_PAIRS, PARALLAX
from sphere_nav_tools.offline.mapping.drive import MappedDrive


@dataclass(frozen=True, eq=False)
class DepthEstimate:
    """What was found, and the pose that the drive was mapped with."""

    found: RefinedDepth
    T_used: SE3

    @property
    def verdict(self) -> str:
        """One line where the drive contradicts the pose it was mapped with, else nothing."""
        if not self.found.contradicts(self.T_used):
            return ""
        off = (self.found.T_image_depth @ self.T_used.inverse()).log()
        scale = np.array([1e3] * 3 + [np.degrees(1.0)] * 3)
        sigma = np.sqrt(np.diagonal(self.found.covariance))
        told = zip(NAMES, off * scale, sigma * scale, strict=True)
        words = ", ".join(f"{name} {value:+.2f} +- {left:.2f}" for name, value, left in told)
        return (
            f"depth camera: this drive places it elsewhere than it was mapped with ({words}; mm, deg; false alarm "
            f"{FALSE_ALARM:.1%})"
        )


class RgbdCollector(ManagedNode):
    """Keeps image and depth of the instants that are wanted."""

    NAME = "rgbd_collector"
    PARAMS = SphereMapperParams
    params: SphereMapperParams

    def configure(self) -> None:
        """Listen."""
        self.wanted: set[int] = set()
        self.found: dict[int, RgbdInstant] = {}
        lookup = TransformListener(self.endpoints, is_required=False).lookup
        Intake(self.params, lambda *_: None, lookup, on_rgbd=self._on_rgbd).subscribe(self.endpoints)

    def _on_rgbd(self, instant: RgbdInstant) -> None:
        if instant.stamp_ns in self.wanted:
            self.found[instant.stamp_ns] = instant


def refine_depth(bag: BagReader, values: dict[str, Any], remap: dict[str, str], drive: MappedDrive) -> DepthEstimate:
    """Return where the depth camera sits by a drive that was mapped with these parameters and topics.

    ValueError where it has too few pairs of images with motion between.
    """
    way = drive.trajectory(is_base=False)
    chosen = choose_pairs(way, _typical_range(drive.mapper))
    if len(chosen) < MIN_PAIRS:
        raise ValueError(
            f"{bag.path}: expected at least {MIN_PAIRS} pairs of images with motion between, found {len(chosen)}: move "
            f"the camera by half of the distance to what it sees, in all directions"
        )
    node = _collect(bag, values, remap, {int(way.stamps_ns[index]) for pair in chosen for index in pair})
    one = next(iter(node.found.values()))
    readout = node.params.camera.readout

    def frame(index: int) -> DepthFrame:
        found, twist = node.found[int(way.stamps_ns[index])], velocity_at(way, index) * readout
        return make_frame(to_gray_bytes(found.image), found.depth_m, found.camera, found.depth_camera, twist)

    pairs = []
    for first, second in tqdm(chosen, desc="depth", unit="pair", leave=False, disable=None):
        T_second_first = way.T_map_body[second].inverse() @ way.T_map_body[first]
        T_second_first = T_BODY_OPTICAL.inverse() @ T_second_first @ T_BODY_OPTICAL
        pairs.append(DepthPair(frame(first), frame(second), T_second_first))
    return DepthEstimate(_refine(pairs, one), one.T_image_depth)


def judge_depth(bag: BagReader, values: dict[str, Any], remap: dict[str, str], drive: MappedDrive) -> str:
    """Return one line where a mapped drive contradicts the depth camera it was mapped with, else nothing."""
    try:
        verdict = refine_depth(bag, values, remap, drive).verdict
    except ValueError:  # too few pairs, or none: it says nothing
        return ""
    return f"{verdict}: sphere_nav refine-camera BAG -o depth.yaml" if verdict else ""


def _refine(pairs: list[DepthPair], one: RgbdInstant) -> RefinedDepth:
    T_image_depth = one.T_image_depth
    for levels in DEPTH_LEVELS:
        seen = [without_hidden(pair, one.camera, T_image_depth) for pair in pairs]
        found = refine_depth_pose(seen, one.camera, T_image_depth, one.T_image_depth, levels)
        T_image_depth = found.T_image_depth
        pairs = [
            DepthPair(pair.first, pair.second, state.pose) for pair, state in zip(pairs, found.states, strict=True)
        ]
    return found


def choose_pairs(way: Trajectory, range_m: float) -> list[tuple[int, int]]:
    """Return pairs of indices with parallax and without much turn between, that share no part of the way."""
    length = float(way.distances[-1]) if len(way) else 0.0
    reach = float(np.clip(length / NUM_PAIRS, PARALLAX[0] * range_m, PARALLAX[1] * range_m))
    pairs, first = [], 0
    for index in range(1, len(way)):
        distance, turn = way.T_map_body[first].distance(way.T_map_body[index])
        if turn > MAX_TURN:
            first = index
        elif distance >= reach:
            pairs.append((first, index))
            first = index
    thinned = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), 2 * NUM_PAIRS)).round().astype(int))
    return [pairs[index] for index in thinned]


def velocity_at(way: Trajectory, index: int) -> NDArray[np.float64]:
    """Return the velocity (6,) of the optical camera at an index by its neighbours."""
    before, after = max(index - 1, 0), min(index + 1, len(way) - 1)
    moved = way.T_map_body[before].inverse() @ way.T_map_body[after]
    elapsed_s = float(way.stamps_ns[after] - way.stamps_ns[before]) * 1e-9
    return (T_BODY_OPTICAL.inverse() @ moved @ T_BODY_OPTICAL).log() / elapsed_s


def _typical_range(mapper: Mapper) -> float:
    ranges = [mapper.load_sphere(node_id).range_m for node_id in mapper.graph.nodes]
    return float(np.median([np.median(range_m[np.isfinite(range_m)]) for range_m in ranges]))


def _collect(bag: BagReader, values: dict[str, Any], remap: dict[str, str], wanted: set[int]) -> RgbdCollector:
    bus = OfflineBus(captured=set())
    node = bus.add(RgbdCollector, values, remap)
    assert isinstance(node, RgbdCollector)
    node.wanted = wanted
    for _ in replay(bag, bus):
        pass
    return node


def describe_components(found: RefinedDepth) -> Iterator[str]:
    """Yield what is told of each component, in mm and deg."""
    values = found.T_image_depth.log()
    values[:3] = found.T_image_depth.translation
    for k, (name, sigma) in enumerate(found.deviations.items()):
        unit, scale = ("mm", 1e3) if k < 3 else ("deg", np.degrees(1.0))
        note = "  NOT OBSERVED by this drive" if name in found.unobserved else ""
        yield f"{name:<8}{values[k] * scale:10.3f} +- {sigma * scale:.3f} {unit}{note}"
