"""Spheres from a ring of sensors and from equirectangular pictures."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import message_to_sphere, pose_to_se3
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.importing.spherical import SENSOR, T_BODY_RIG

RADIUS = 2.0  # m, of a cylinder around the rig's vertical axis


def range_of_cylinder(directions):
    return RADIUS / np.linalg.norm(directions[..., :2], axis=-1)


@pytest.fixture
def ring(tmp_path):
    """Eight sensors, 45 degrees apart, in a cylinder whose grey level tells the azimuth."""
    folder = tmp_path / "ring"
    (folder / "Extrinsics").mkdir(parents=True)
    for name in ("sphere_1", "sphere_2"):
        (folder / name).mkdir()
    rays = SENSOR.unproject(pixel_grid(SENSOR))
    for number in range(1, 9):
        T_rig_sensor = SE3.exp([0, 0, 0, np.pi / 4 * (number - 1), 0, 0])
        np.savetxt(folder / "Extrinsics" / f"Rt_0{number}.txt", T_rig_sensor.matrix)
        directions = rays @ (T_BODY_RIG @ T_rig_sensor).rotation.T
        depth = range_of_cylinder(directions) * rays[..., 2]
        azimuth = np.arctan2(directions[..., 1], directions[..., 0])
        gray = np.rint(128 + 100 * np.sin(azimuth)).astype(np.uint8)
        for name in ("sphere_1", "sphere_2"):
            cv2.imwrite(str(folder / name / f"rgb_{number}.png"), np.dstack([gray, gray // 2, gray]))
            cv2.imwrite(str(folder / name / f"depth_{number}.png"), np.rint(depth * 1000).astype(np.uint16))
    np.savetxt(folder / "gicp_T_sphere1_sphere2.txt", SE3.exp([0.1, 0.2, 0.3, 0, 0, 0]).matrix)
    return folder


def spheres_of(path):
    with BagReader(path) as bag:
        return [message_to_sphere(item.message) for item in bag.messages(["sphere"])], [
            pose_to_se3(item.message.pose) for item in bag.messages(["ground_truth/pose"])
        ]


@pytest.mark.slow
def test_a_ring_becomes_a_sphere_with_z_up(ring, tmp_path):
    assert main(["import", "spherical", str(ring), "-o", str(tmp_path / "bag")]) == 0
    spheres, poses = spheres_of(tmp_path / "bag")
    assert len(spheres) == 2
    sphere = spheres[0]
    directions = sphere.camera.unproject(pixel_grid(sphere.camera))
    seen = np.isfinite(sphere.range_m)
    rows = np.abs(directions[..., 2]) < np.sin(np.radians(25))  # the sensors lie on their side: 63 degrees high
    assert seen[rows].mean() > 0.99
    np.testing.assert_allclose(sphere.range_m[seen], range_of_cylinder(directions)[seen], atol=0.01)
    azimuth = np.arctan2(directions[..., 1], directions[..., 0])
    gray = 128 + 100 * np.sin(azimuth)
    assert (
        np.abs(sphere.image[..., 0].astype(float) - gray)[seen].max() < 4
    )  # 100 grey levels a radian, a pixel is 4 mrad
    assert np.abs(sphere.image[..., 1].astype(float) - gray / 2)[seen].max() < 4
    np.testing.assert_allclose(poses[0].matrix, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(poses[1].translation, [0.3, -0.2, 0.1], atol=1e-9)  # the rig's x is up, its z forward
