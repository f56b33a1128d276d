"""Where the camera of a drive sits on the vehicle, by its poses in a map and the odometry of the bag."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rig_calibration.drive.mounting import NAMES, Mounting, find_mounting
from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.offline import topics
from sphere_nav.offline.pose_bags import read_poses
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.camera.mounting import NAMES as POSE
from sphere_nav.ros.camera.mounting import read_mounting

MAX_GAP_NS = 200_000_000  # of the odometry, between two poses


def mounting_by_odometry(
    arguments: argparse.Namespace, frame_id: str, odometry: str, camera: Trajectory
) -> tuple[Mounting | None, str]:
    """Return the mounting by the poses of the camera (optical axes) in the map and the odometry; or none, and why.

    It starts from --mounting or /tf_static; without either the camera may look anywhere.
    """
    if not odometry:
        return None, "the bag has no odometry"
    given = read_mounting(arguments.mounting)
    with BagReader(arguments.source) as bag:
        tree = topics.read_frames(bag)
    if given is None and tree.is_connected(topics.BASE_FRAME, frame_id):
        given = tree.lookup(topics.BASE_FRAME, frame_id) @ T_BODY_OPTICAL.inverse()
    base, is_known = read_poses(bag.path, (odometry,)).at(camera.stamps_ns, MAX_GAP_NS)
    T_map_body: SE3 = camera.T_map_body[is_known] @ T_BODY_OPTICAL.inverse()
    try:
        return find_mounting(T_map_body, base.T_map_body, given), ""
    except ValueError as error:
        return None, str(error).removeprefix("mounting: ")


def mounting_values(found: Mounting) -> dict[str, dict[str, float]]:
    """Return what the calibration file says: the six numbers that --mounting reads, and deviations beside."""
    values, deviations = (dict(zip(NAMES, map(float, v), strict=True)) for v in (found.values, found.deviations))
    return {"mounting": {name: values[name] for name in POSE}, "mounting_standard_deviations": deviations}


def mounting_lines(found: Mounting) -> Iterator[str]:
    """Yield what is printed."""
    left = "{:.3f} m, {:.4f} rad".format(*found.rms)
    yield f"mounting on {topics.BASE_FRAME}: {found.num_pieces} pieces of the drive, left of each {left}"
    for name, value, sigma in zip(NAMES, found.values, found.deviations, strict=True):
        note = "  NOT OBSERVED by this drive: as it was given" if name in found.unobserved else ""
        yield f"{name:<15}{value:10.4f} +- {sigma:.4f}{note}"
    if found.unobserved:
        yield "a place shows in turns, a height on ramps and bumps only: measure what is missing"
