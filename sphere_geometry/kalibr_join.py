"""Several camchains of one rig as one: they share the IMU, or a camera, told by its topic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sphere_geometry.foreign_cameras import ForeignRig
from sphere_geometry.se3 import SE3


def join(chains: Sequence[ForeignRig], paths: Sequence[Path]) -> ForeignRig:
    """Return the cameras of all chains, named cam0, cam1, ... in the order of files; a shared camera counts once.

    Poses are relative to the IMU where every chain has them, else to the first camera of the first file. ValueError
    naming the file that shares nothing with those before it.
    """
    if all(chain.is_by_imu for chain in chains):
        origins = [SE3.identity() for _ in chains]
        is_by_imu = True
    else:
        origins, is_by_imu = _by_shared_camera(chains, paths), False
    cameras, poses, fits, topics = [], [], [], []
    for chain, T_first_chain in zip(chains, origins, strict=True):
        for index, camera in enumerate(chain.cameras):
            if chain.topics[index] and chain.topics[index] in topics:
                continue
            cameras.append(camera)
            poses.append(T_first_chain @ chain.T_origin_camera[index])
            fits.append(chain.fits[index])
            topics.append(chain.topics[index])
    names = tuple(f"cam{number}" for number in range(len(cameras)))
    return ForeignRig(names, tuple(cameras), tuple(poses), is_by_imu, tuple(fits), tuple(topics))


def _by_shared_camera(chains: Sequence[ForeignRig], paths: Sequence[Path]) -> list[SE3]:
    """Return the pose of every chain's origin in that of the first."""
    origins, known = [SE3.identity()], {t: T for t, T in _poses(chains[0]).items() if t}
    for chain, path in zip(chains[1:], paths[1:], strict=True):
        own = _poses(chain)
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


def _poses(chain: ForeignRig) -> dict[str, SE3]:
    return {topic: T for topic, T in zip(chain.topics, chain.T_origin_camera, strict=True) if topic}
