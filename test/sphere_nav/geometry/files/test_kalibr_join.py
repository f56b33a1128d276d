"""Several camchains of one rig are one rig."""

import numpy as np

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.files.foreign_cameras import ForeignRig
from sphere_nav.geometry.files.kalibr_file import join_chains

LENS = Pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
POSES = [SE3.exp(xi) for xi in np.random.default_rng(3).normal(0.0, 0.5, (4, 6))]  # T_rig_camera of a, b, c, d


def chain(topics, *, is_by_imu=False):
    """The cameras of these topics; the origin is the rig (the IMU), or the first of them."""
    poses = [POSES["abcd".index(topic)] for topic in topics]
    origin = SE3.identity() if is_by_imu else poses[0]
    own = tuple(origin.inverse() @ pose for pose in poses)
    number = len(topics)
    return ForeignRig(tuple(f"cam{k}" for k in range(number)), (LENS,) * number, own, is_by_imu, tuple(topics))


def test_chains_that_share_a_camera_are_joined_by_it():
    found = join_chains([chain("ab"), chain("bc"), chain("cd")], ["1.yaml", "2.yaml", "3.yaml"])
    assert found.names == ("cam0", "cam1", "cam2", "cam3")
    assert found.topics == tuple("abcd")
    for mine, theirs in zip(found.T_origin_camera, POSES, strict=True):
        np.testing.assert_allclose(mine.matrix, (POSES[0].inverse() @ theirs).matrix, atol=1e-12)


def test_chains_that_share_the_imu_are_joined_by_it():
    found = join_chains([chain("ab", is_by_imu=True), chain("cd", is_by_imu=True)], ["1.yaml", "2.yaml"])
    assert found.is_by_imu
    for mine, theirs in zip(found.T_origin_camera, POSES, strict=True):
        np.testing.assert_allclose(mine.matrix, theirs.matrix, atol=1e-12)
