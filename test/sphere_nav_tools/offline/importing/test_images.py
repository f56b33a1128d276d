"""Folders of images, videos, rings of sensors and recorded sets become bags that the other commands read."""

import shlex

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import message_to_sphere, stamp_ns
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing import images
from sphere_nav_tools.offline.importing.images import T_BODY_RIG, open_images
from worlds.commands import call
from worlds.rig import WAVES

LENS = Pinhole(320, 240, 300.0, 300.0, 159.5, 119.5)


def wall(shift):
    """A textured wall 4 m ahead of a camera so far (m) to the right."""
    rays = LENS.unproject(pixel_grid(LENS))
    points = rays / rays[..., 2:] * 4.0 + [shift, 0.0, 0.0]
    levels = 128 + 14 * np.sum(np.sin(points @ WAVES.T * 3.0 + np.arange(24)), axis=-1)
    return np.clip(levels, 1, 255).astype(np.uint8)


def write(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def video_of(path, hz, images):
    height, width, _ = images[0].shape
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), hz, (width, height))
    for image in images:
        video.write(image)
    video.release()
    return path


def test_a_camera_may_lack_an_image_where_names_are_stamps(tmp_path):
    parts = tuple(RigCamera(name, LENS, T_BODY_OPTICAL) for name in ("front", "rear"))
    write_rig(tmp_path / "rig.yaml", Rig(parts))
    for number in range(3):
        write(tmp_path / "in" / "front" / f"{1403636579000000000 + number * 50_000_000}.png", wall(0.0))
        if number != 1:
            write(tmp_path / "in" / "rear" / f"{1403636579000900000 + number * 50_000_000}.png", wall(0.0))
    assert call("import", "images", tmp_path / "in", "-o", tmp_path / "bag", "--rig", tmp_path / "rig.yaml") == 0
    with BagReader(tmp_path / "bag") as bag:
        for name, stamps in (
            ("front", [1403636579000000000 + k * 50_000_000 for k in range(3)]),
            ("rear", [1403636579000900000, 1403636579100900000]),
        ):
            assert [stamp_ns(item.message) for item in bag.messages([f"cameras/{name}/image_raw"])] == stamps


def test_a_video_of_one_camera_keeps_its_rate(imported, tmp_path):
    video = video_of(tmp_path / "drive.avi", 25.0, [np.dstack([wall(0.1 * number)] * 3) for number in range(5)])
    topics, _ = imported("images", video, "--camera", "300,300,159.5,119.5", "--frames", "1:4")
    assert np.diff([*map(stamp_ns, topics["/image_raw"])]).tolist() == [40_000_000] * 2


def test_a_360_video_becomes_images_that_say_they_are_whole_spheres(capsys, tmp_path):
    video = video_of(tmp_path / "walk.avi", 10.0, [np.full((64, 128, 3), 40 * number, np.uint8) for number in range(3)])
    assert call("inspect", video) == 0
    [line] = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  sphere_nav import")]
    words = shlex.split(line.replace("walk_bag", str(tmp_path / "bag")))  # as it is typed
    assert call(*words[1:]) == 0
    with BagReader(tmp_path / "bag") as bag:
        [info, *_] = [item.message for item in bag.messages(["/sphere_info"])]
        [image, *more] = [item.message for item in bag.messages(["/image_raw"])]
    assert (info.width, info.height, info.frame_id) == (128, 64, image.header.frame_id)
    assert len(more) == 2
    capsys.readouterr()
    call("inspect", tmp_path / "bag")
    printed = capsys.readouterr().out
    assert "sphere_nav localize MAP" in printed
    assert "is_panorama" not in printed  # it is told
    assert "one camera alone cannot map: add depth" in printed


def test_a_folder_that_is_no_bag_is_named_with_its_command(capsys, tmp_path):
    write(tmp_path / "phone" / "1.png", wall(0.0))
    (tmp_path / "empty").mkdir()
    assert call("inspect", tmp_path / "phone") == 0
    printed = capsys.readouterr().out
    assert "1 images of 320 x 240" in printed
    assert "phone_bag --camera 320,320,159.5,119.5" in printed
    assert call("inspect", tmp_path / "empty") == 2
    assert call("import", "images", tmp_path / "phone", "-o", tmp_path / "bag", "--panorama") == 2
    assert "phone/1.png: expected 2 H x H pixels of a whole sphere, found 320 x 240" in capsys.readouterr().err


def test_panoramas_one_above_the_other_become_spheres_with_range(tmp_path):
    camera, folder = Spherical(256, 128), tmp_path / "pairs"
    rays = camera.unproject(pixel_grid(camera))
    for level, up in (("top", 0.0), ("bottom", -0.3)):
        points = rays * range_of_cylinder(rays)[..., None] + [0.0, 0.0, up]
        levels = 128 + 14 * np.sum(np.sin(points @ WAVES.T * 2.0 + np.arange(24)), axis=-1)
        write(folder / level / f"{1403636579000000000}.png", np.clip(levels, 1, 255).astype(np.uint8))
    recording = open_images(folder, None, None, 0.3, None)
    sphere = message_to_sphere(dict(recording.frame(0))["sphere"])
    assert sphere.stamp_ns == recording.instants[0].stamp_ns == 1403636579000000000
    error = np.abs(sphere.range_m / range_of_cylinder(rays) - 1.0)[45:83]
    assert np.isfinite(error).mean() > 0.8
    assert np.nanmedian(error) < 0.02
    write(folder / "bottom" / f"{1403636579000000000}.png", np.full((64, 128), 9, np.uint8))
    with pytest.raises(ValueError, match=r"bottom/\d+\.png: expected 256 x 128 pixels, found 128 x 64"):
        dict(recording.frame(0))
    (folder / "bottom" / f"{1403636579000000000}.png").rename(folder / "bottom" / f"{1403636580000000000}.png")
    with pytest.raises(ValueError, match="expected pairs of one time in top and bottom, found none"):
        open_images(folder, None, None, 0.3, None)


SENSOR = Pinhole(80, 60, 65.625, 65.625, 39.5, 29.5)
RADIUS = 2.0  # m, of a cylinder around the rig's vertical axis


def range_of_cylinder(directions):
    return RADIUS / np.linalg.norm(directions[..., :2], axis=-1)


@pytest.fixture
def ring(tmp_path, monkeypatch):
    """Eight small sensors, 45 degrees apart, in a cylinder whose grey level tells the azimuth."""
    monkeypatch.setattr(images, "SENSOR", SENSOR)
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


def test_a_ring_becomes_a_sphere_with_z_up(ring):
    recording = images.open_spherical(ring)
    sphere = message_to_sphere(dict(recording.frame(0))["sphere"])
    poses = [instant.T_map_link for instant in recording.instants]
    directions = sphere.camera.unproject(pixel_grid(sphere.camera))
    seen = np.isfinite(sphere.range_m)
    rows = np.abs(directions[..., 2]) < np.sin(np.radians(25))  # the sensors lie on their side: 63 degrees high
    assert seen[rows].mean() > 0.99
    np.testing.assert_allclose(sphere.range_m[seen], range_of_cylinder(directions)[seen], atol=0.01)
    azimuth = np.arctan2(directions[..., 1], directions[..., 0])
    gray = 128 + 100 * np.sin(azimuth)
    # 100 grey levels a radian, a pixel is 15 mrad
    assert np.abs(sphere.image[..., 0].astype(float) - gray)[seen].max() < 5  # with gains to 1 %
    assert np.abs(sphere.image[..., 1].astype(float) - gray / 2)[seen].max() < 4
    np.testing.assert_allclose(poses[0].matrix, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(poses[1].translation, [0.3, -0.2, 0.1], atol=1e-9)  # the rig's x is up, its z forward


def test_panoramas_with_range_become_spheres_at_their_poses(tmp_path):
    for number in range(2):
        write(tmp_path / f"image_{number}.png", np.full((8, 16, 3), 100 + number, np.uint8))
        write(tmp_path / f"range_{number}.png", np.full((8, 16), 2000 + 500 * number, np.uint16))
    np.savetxt(tmp_path / "poses.tum", [[k, 3.0 * k, 0, 0, 0, 0, 0, 1] for k in range(2)])
    recording = images.open_spherical(tmp_path)
    assert [instant.T_map_link.translation[0] for instant in recording.instants] == [0.0, 3.0]
    sphere = message_to_sphere(dict(recording.frame(1))["sphere"])
    assert (sphere.image[0, 0, 0], sphere.stamp_ns) == (101, recording.instants[0].stamp_ns + 1_000_000_000)
    np.testing.assert_allclose(sphere.range_m, 2.5, rtol=2e-3)
