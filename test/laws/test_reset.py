"""After `reset()`, or a clock that was set back, an object is as a new one: nothing of the last drive steers the next.

All that an object holds is spoiled first, whatever it is called, so that what a change adds is asked, too.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dense_localizer.inputs import Inputs
from dense_localizer.judge.integrity import Integrity
from dense_localizer.judge.lens_watch import LensWatch, ViewMask
from dense_localizer.judge.odometry_check import OdometryCheck
from dense_localizer.localizer import Localizer
from dense_localizer.motion_prior import InterFrame, PosePrior
from dense_localizer.params import LocalizerParams, PriorParams
from dense_localizer.start.search import PoseSearch
from dense_localizer.track.visual_odometry import VisualOdometry
from mcl_depth.belief.dead_reckoning import DeadReckoning
from mcl_depth.belief.evidence import Evidence
from mcl_depth.belief.image_motion import ReconciledOdometry
from mcl_depth.belief.joint_evidence import JointEvidence
from mcl_depth.homing import Homing
from mcl_depth.params import DirectionParams, MclInputParams, MotionParams
from path_follower.arming import Arming
from path_follower.consistency import NO_VARIANCE, Comparison, MotionConsistency
from path_follower.params import FollowerParams, PathFollowerParams
from path_follower.ros.control import ControlLoop
from path_follower.ros.intake import Answered
from path_follower.safety import SafetyMonitor
from path_follower.vehicle import Limiter, Predictor
from sphere_mapping.acquisition.params import SphereStitcherParams
from sphere_mapping.acquisition.ros.rig_intake import Clouds, RigIntake
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.odometry import Agreement
from sphere_nav.localization import InputCheck
from sphere_nav.localization.params import InputParams, NodeParams, StateParams
from sphere_nav.localization.status import StateMachine
from sphere_nav.photometric import RegistrationParams
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.camera.stream import CameraStream
from sphere_nav.ros.camera.synchronizer import CameraHealth, Synchronizer
from sphere_nav.ros.clocks import SimulatedTicks
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.localizer.pose_outputs import MapTransform
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformTree
from worlds.localizer import make_map
from worlds.rig import vertical_rig
from worlds.room import Room

SPOILED = object()
FOLLOWER = FollowerParams()


def endpoints() -> Any:
    return OfflineBus().add(ManagedNode).endpoints


def odometry_input() -> OdometryInput:
    return OdometryInput(endpoints(), TransformTree(), "base_link")


def transform_tree() -> TransformTree:
    tree = TransformTree()
    tree.add(se3_to_transform(SE3.identity(), 1, "odom", "base_link"))
    tree.clear()
    return tree


def camera_stream() -> CameraStream:
    ignored: Any = SimpleNamespace()
    return CameraStream(endpoints(), NodeParams(), ignored, odometry_input(), print, print)


# How one is made, how it is reset, and what it keeps by intent: what it was made with, what no drive changes.
RESETS: dict[str, tuple[Any, Any, str]] = {
    "Agreement": (Agreement, "clear", "max_gap_ns"),
    "Answered": (lambda: Answered(None, print, print), "forget", "endpoints answer catch_up is_patient"),
    "Arming": (lambda: Arming(FOLLOWER), "reset", "params mode path location"),
    "CameraStream": (camera_stream, "forget_camera",
                     "endpoints params tf odometry on_picture on_refusal name lens place images lens_topics"),
    "Clouds": (Clouds, "clear", ""),
    "Comparison": (Comparison, lambda one: one.reset(NO_VARIANCE), ""),
    "ControlLoop": (lambda: ControlLoop(endpoints(), PathFollowerParams()), "clock_jumped",
                    "endpoints params clock_watch cycle ticks cmd_vel sent sent_ns ackermann tracking "
                    "status heartbeat beats intake scans peers"),
    "DeadReckoning": (lambda: DeadReckoning(MclInputParams(), MotionParams()), "reset", "params noise"),
    "Evidence": (lambda: Evidence(SimpleNamespace(edge=0.5, diagonal=0.7, positions=()), 1e-3, 2.4), "reset",
                 "grid max_chance chance_scale"),
    "Homing": (lambda: Homing(np.array([[0.0, 0.0], [9.0, 0.0]]), DirectionParams()), "restart",
               "waypoints way params offsets"),
    "InputCheck": (lambda: InputCheck(InputParams()), "reset", "params"),
    "Inputs": (lambda: Inputs(LocalizerParams(), 1e6), "reset", "params pixels_per_radian"),
    "Integrity": (lambda: Integrity(SimpleNamespace(error=None, pixels_per_radian=326.0), LocalizerParams()), "reset",
                  "references map_error params"),  # the map stays known
    "InterFrame": (lambda: InterFrame(RegistrationParams()), "reset", "params"),
    "JointEvidence": (lambda: JointEvidence(0.5, 1.0), "reset", "edge new_way"),
    "LensWatch": (LensWatch, "reset", "limit"),
    "Localizer": (lambda: Localizer(LocalizerParams(), make_map(Room(), [SE3.identity()], Spherical(64, 32))), "reset",
                  "params references range_support"),
    "MapTransform": (lambda: MapTransform(endpoints(), odometry_input(), "map", "base"), "clear",
                     "endpoints odometry map_frame base_frame output"),
    "MotionConsistency": (lambda: MotionConsistency(FOLLOWER, None), "reset", "params predictor"),
    "OdometryCheck": (lambda: OdometryCheck(0.05), "reset", "error"),
    "OdometryInput": (odometry_input, "reset", "endpoints tree base_frame topic"),
    "PosePrior": (lambda: PosePrior(PriorParams()), "reset", "params drift inter_frame"),  # drift: from each start on
    "PoseSearch": (lambda: PoseSearch(SimpleNamespace(), LocalizerParams()), "reset",
                   "references params is_automatic startup"),
    "Predictor": (lambda: Predictor(FOLLOWER.vehicle, FOLLOWER.actuation), "reset", "vehicle actuation"),
    "ReconciledOdometry": (lambda: ReconciledOdometry(None, MotionParams()), "reset", "map params"),
    "RigIntake": (lambda: RigIntake(vertical_rig(), SphereStitcherParams(), None, None, None), "clear",
                  "rig params T_rig_lidar now_ns lookup on_instants has_points levels"),
    "SafetyMonitor": (lambda: SafetyMonitor(FOLLOWER, None), "reset", "params is_emergency outside"),
    "SimulatedTicks": (lambda: SimulatedTicks(0.1, 0.1), lambda one: one.restart(0), "silence_ns period_ns"),
    "StateMachine": (lambda: StateMachine(StateParams()), "reset", "params"),
    "Synchronizer": (lambda: Synchronizer(("left", "right"), 0.1), "clear",
                     "names slack_s slack_ns deadline_ns is_ready num_first"),
    "TransformTree": (transform_tree, "clear", ""),  # what does not move holds at any time
    "ViewMask": (lambda: ViewMask(RegistrationParams()), "reset", "params without_hidden"),
    "VisualOdometry": (lambda: VisualOdometry(None, LocalizerParams()), "reset", "references params"),
}  # fmt: skip
# Parts of the above that have no reset of their own.
PARTS = {
    CameraHealth.__name__: {"num_missing", "problem"},
    Limiter.__name__: {"params", "is_launch", "last", "gain"},
    "Follower": set(RESETS["Arming"][2].split()),
    "_Edge": {"parent", "fixed"},
}
KEPT = {name: set(kept.split()) for name, (_, _, kept) in RESETS.items()} | PARTS


def spoil(value: Any) -> Any:
    """Return another value in place of one; what has parts is spoiled as it is."""
    kind = type(value)
    if kind.__name__ in KEPT:
        for name, part in vars(value).items():
            if name.lstrip("_") not in KEPT[kind.__name__]:
                setattr(value, name, spoil(part))
        return value
    if isinstance(value, deque | list):
        value.append(SPOILED)
        return value
    if isinstance(value, dict | OrderedDict):
        spoiled = {key: spoil(part) for key, part in value.items()}
        if not any(type(part).__name__ in KEPT for part in spoiled.values()):
            spoiled[SPOILED] = SPOILED
        value.update(spoiled)
        return value
    if isinstance(value, tuple) and any(isinstance(part, deque) for part in value):
        return tuple(map(spoil, value))
    if isinstance(value, bool):
        return not value
    return value + 7 if isinstance(value, int | float | np.ndarray) else SPOILED


def state(value: Any) -> Any:
    """Return all that an object holds, but what it keeps, to be compared."""
    name = type(value).__name__
    if name in KEPT:
        held = {key: state(part) for key, part in vars(value).items() if key.lstrip("_") not in KEPT[name]}
        return name, held
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: state(part) for key, part in value.items()}
    if isinstance(value, deque | list | tuple):
        return [state(part) for part in value]
    if hasattr(value, "__dict__") and not callable(value) and type(value).__eq__ is object.__eq__:
        return name, {key: state(part) for key, part in vars(value).items()}
    return value


@pytest.mark.parametrize("name", RESETS)
def test_nothing_of_the_last_drive_steers_the_next(name: str) -> None:
    make, reset, kept = RESETS[name]
    used, new = make(), make()
    assert {key.lstrip("_") for key in vars(used)} >= set(kept.split())
    if vars(used):
        spoil(used)
        assert state(used) != state(new)
    if isinstance(reset, str):
        getattr(used, reset)()
    else:
        reset(used)
    assert state(used) == state(new)
