"""Kalibr's camchain: cam0, cam1, ..., each placed relative to the one before it, to the IMU, or both.

Several camchains of one rig as one: they share the IMU, or a camera, told by its topic.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.files.foreign_cameras import ForeignLens, ForeignRig, image_size, refuse_model, vector
from sphere_nav.geometry.files.opencv_file import without_directive
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_yaml, pose, read_text, required, short, told_at
from sphere_nav.geometry.se3 import SE3


def join_chains(chains: Sequence[ForeignRig], paths: Sequence[Path]) -> ForeignRig:
    """Return the cameras of all chains, named cam0, cam1, ... in the order of files; a shared camera counts once.

    Poses are relative to the IMU where every chain has them, else to the first camera of the first file. ValueError
    naming the file that shares nothing with those before it.
    """
    if all(chain.is_by_imu for chain in chains):
        origins = [SE3.identity() for _ in chains]
        is_by_imu = True
    else:
        origins, is_by_imu = _by_shared_camera(chains, paths), False
    cameras, poses, topics = [], [], []
    for chain, T_first_chain in zip(chains, origins, strict=True):
        for index, camera in enumerate(chain.cameras):
            if chain.topics[index] and chain.topics[index] in topics:
                continue
            cameras.append(camera)
            poses.append(T_first_chain @ chain.T_origin_camera[index])
            topics.append(chain.topics[index])
    names = tuple(f"cam{number}" for number in range(len(cameras)))
    return ForeignRig(names, tuple(cameras), tuple(poses), is_by_imu, tuple(topics))


def _by_shared_camera(chains: Sequence[ForeignRig], paths: Sequence[Path]) -> list[SE3]:
    """Return the pose of every chain's origin in that of the first."""
    origins, known = [SE3.identity()], {t: T for t, T in _camera_poses(chains[0]).items() if t}
    for chain, path in zip(chains[1:], paths[1:], strict=True):
        own = _camera_poses(chain)
        shared = next((topic for topic in own if topic in known), None)
        if shared is None:
            told = ", ".join(topic or "none" for topic in chain.topics)
            raise ValueError(
                f"{path}: expected poses relative to the IMU in all files, or a rostopic of a file before it "
                f"({', '.join(known) or 'none'}), found {told}"
            )
        origins.append(known[shared] @ own[shared].inverse())
        known |= {topic: origins[-1] @ T for topic, T in own.items() if topic not in known}
    return origins


def _camera_poses(chain: ForeignRig) -> dict[str, SE3]:
    return {topic: T for topic, T in zip(chain.topics, chain.T_origin_camera, strict=True) if topic}


NAME = re.compile(r"cam([0-9]{1,3})")
NUM_INTRINSICS = {"pinhole": 4, "omni": 5, "ds": 6}  # fu fv pu pv, behind xi (omni) or xi alpha (ds)
NUM_DISTORTION = {"radtan": 4, "equidistant": 4, "none": 0}
KNOWN = "pinhole with radtan, equidistant or none, ds with none, omni with none or radtan"
AGREEMENT = 1e-3  # m and rad between a pose by the chain and the same by the IMU


def is_kalibr(values: Any) -> bool:
    """Whether these are the values of a camchain."""
    return isinstance(values, dict) and any(NAME.fullmatch(str(key)) for key in values)


def read_kalibr(path: Path) -> ForeignRig:
    """Return the cameras of a camchain (https://github.com/ethz-asl/kalibr/wiki/yaml-formats).

    `T_cn_cnm1` takes points of camera n - 1 to camera n, `T_cam_imu` points of the IMU to the camera; both point the
    other way than ours do.
    """
    values = load_yaml(path, without_directive(read_text(path, "Kalibr camchain", MAX_FILE_BYTES)))
    with told_at(path):
        return _rig(values)


def _rig(values: Any) -> ForeignRig:
    if not is_kalibr(values):
        raise ValueError(f"camchain: expected cam0, cam1, ..., found {short(values)}")
    names = sorted((str(key) for key in values if NAME.fullmatch(str(key))), key=lambda name: int(name[3:]))
    if names != [f"cam{number}" for number in range(len(names))]:
        raise ValueError(f"camchain: expected cam0 to cam{len(names) - 1}, found {', '.join(names)}")
    entries = [required(values[name], name, ("camera_model", "intrinsics", "resolution")) for name in names]
    cameras = tuple(_camera(name, entry) for name, entry in zip(names, entries, strict=True))
    by_imu = [_by_imu(name, entry) for name, entry in zip(names, entries, strict=True)]
    poses, is_by_imu = _poses(names, entries, by_imu)
    topics = tuple(str(entry.get("rostopic") or "") for entry in entries)
    return ForeignRig(tuple(names), cameras, tuple(poses), is_by_imu, topics)


def _camera(name: str, entry: Mapping[str, Any]) -> Camera:
    model, distortion = entry["camera_model"], entry.get("distortion_model") or "none"
    if not isinstance(model, str) or model not in NUM_INTRINSICS:
        raise refuse_model(model, f"{name}.camera_model", KNOWN)
    is_known = isinstance(distortion, str) and distortion in NUM_DISTORTION
    if not is_known or (model != "pinhole" and distortion != "none" and (model, distortion) != ("omni", "radtan")):
        raise refuse_model(f"{model} with {distortion!s:.40}", f"{name}.distortion_model", KNOWN)
    numbers = vector(entry, "intrinsics", name, NUM_INTRINSICS[model])
    k = vector(entry, "distortion_coeffs", name, NUM_DISTORTION[distortion])
    size = image_size(entry["resolution"], f"{name}.resolution")
    fu, fv, pu, pv = numbers[-4:]
    lens = ForeignLens(size, fu, fv, pu, pv, f"{name}.intrinsics")
    if model == "ds":
        return lens.double_sphere(*numbers[:2])
    if model == "omni":
        return lens.omni(numbers[0], k)
    return lens.fisheye(k) if distortion == "equidistant" else lens.pinhole(k)


def _by_imu(name: str, entry: Mapping[str, Any]) -> SE3 | None:
    """Return `T_imu_camera` where the file has it, one way or the other."""
    if "T_cam_imu" in entry:
        return pose(entry["T_cam_imu"], f"{name}.T_cam_imu").inverse()
    return pose(entry["T_imu_cam"], f"{name}.T_imu_cam") if "T_imu_cam" in entry else None


def _poses(names: list[str], entries: list[Mapping[str, Any]], by_imu: list[SE3 | None]) -> tuple[list[SE3], bool]:
    """Return the poses relative to the IMU, or to cam0, and which of them it is; both ways must agree."""
    first = by_imu[0]
    poses = [SE3.identity() if first is None else first]
    for name, entry, T_imu_camera in zip(names[1:], entries[1:], by_imu[1:], strict=True):
        if "T_cn_cnm1" in entry:
            found = poses[-1] @ pose(entry["T_cn_cnm1"], f"{name}.T_cn_cnm1").inverse()
            if first is not None and T_imu_camera is not None and _apart(found, T_imu_camera) > AGREEMENT:
                raise ValueError(
                    f"{name}.T_cam_imu: expected what T_cn_cnm1 and the camera before it say, found a pose "
                    f"{_apart(found, T_imu_camera):.3g} m or rad away"
                )
        elif first is not None and T_imu_camera is not None:
            found = T_imu_camera
        else:
            raise ValueError(f"{name}.T_cn_cnm1: expected a pose, found none, nor T_cam_imu of all cameras")
        poses.append(found)
    return poses, first is not None


def _apart(first: SE3, second: SE3) -> float:
    return float(np.max(first.distance(second)))
