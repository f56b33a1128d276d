"""Folders of images and videos become bags that the other commands read."""

import json

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags import BagReader
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.main import main
from worlds.rig import WAVES, seen, vertical_rig

LENS = Pinhole(320, 240, 300.0, 300.0, 159.5, 119.5)


def call(*words):
    return main([str(word) for word in words])


def headers(path):
    """Return by topic the stamps of all images."""
    found = {}
    with BagReader(path) as bag:
        for item in bag.messages([topic for topic in bag.topics if topic.endswith("image_raw")]):
            stamp = item.message.header.stamp
            found.setdefault(item.topic.lstrip("/"), []).append(stamp.sec * 1_000_000_000 + stamp.nanosec)
    return found


def wall(shift, lens=LENS):
    """A textured wall 4 m ahead of a camera so far (m) to the right."""
    rays = lens.unproject(pixel_grid(lens))
    points = rays / rays[..., 2:] * 4.0 + [shift, 0.0, 0.0]
    levels = 128 + 14 * np.sum(np.sin(points @ WAVES.T * 3.0 + np.arange(24)), axis=-1)
    return np.clip(levels, 1, 255).astype(np.uint8)


def write(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def test_a_folder_of_a_rig_becomes_the_topic_of_its_camera(tmp_path):
    rig = vertical_rig()
    write_rig(tmp_path / "rig.yaml", rig)
    for part in rig.cameras:
        for number in range(2):
            write(tmp_path / "in" / part.name / f"{number:04d}.png", seen(part))
    assert call("import", "images", tmp_path / "in", "-o", tmp_path / "bag", "--rig", tmp_path / "rig.yaml") == 0
    stamps = headers(tmp_path / "bag")
    assert set(stamps) == {f"cameras/{name}/image_raw" for name in rig.names}
    assert all(np.diff(found) == [100_000_000] for found in stamps.values())  # 10 Hz, where nothing tells


def test_a_camera_may_lack_an_image_where_names_are_stamps(tmp_path):
    parts = tuple(RigCamera(name, LENS, T_BODY_OPTICAL) for name in ("front", "rear"))
    write_rig(tmp_path / "rig.yaml", Rig(parts))
    for number in range(3):
        write(tmp_path / "in" / "front" / f"{1403636579000000000 + number * 50_000_000}.png", wall(0.0))
        if number != 1:
            write(tmp_path / "in" / "rear" / f"{1403636579000900000 + number * 50_000_000}.png", wall(0.0))
    assert call("import", "images", tmp_path / "in", "-o", tmp_path / "bag", "--rig", tmp_path / "rig.yaml") == 0
    stamps = headers(tmp_path / "bag")
    assert stamps["cameras/front/image_raw"] == [1403636579000000000 + k * 50_000_000 for k in range(3)]
    assert stamps["cameras/rear/image_raw"] == [1403636579000900000, 1403636579100900000]


@pytest.mark.slow
def test_a_stereo_pair_by_its_rig_is_registered(capsys, tmp_path):
    for number in range(2):
        write(tmp_path / "in" / "left" / f"{number}.png", wall(0.05 * number))
        write(tmp_path / "in" / "right" / f"{number}.png", wall(0.05 * number + 0.3))
    poses = [SE3.from_parts(T_BODY_OPTICAL.rotation, [0.0, y, 0.0]) for y in (0.0, -0.3)]
    write_rig(tmp_path / "rig.yaml", Rig(tuple(map(RigCamera, ("left", "right"), (LENS, LENS), poses))))
    assert call("import", "images", tmp_path / "in", "-o", tmp_path / "bag", "--rig", tmp_path / "rig.yaml") == 0
    capsys.readouterr()
    assert call("register", f"{tmp_path / 'bag'}:0", f"{tmp_path / 'bag'}:1") == 0
    found = json.loads(capsys.readouterr().out)["T_a_b"]["translation_m"]
    np.testing.assert_allclose(found, [0.0, -0.05, 0.0], atol=0.005)


def test_a_video_of_one_camera_keeps_its_rate(tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "drive.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (320, 240))
    for number in range(5):
        video.write(cv2.cvtColor(wall(0.1 * number), cv2.COLOR_GRAY2BGR))
    video.release()
    words = ("--camera", "300,300,159.5,119.5", "--frames", "1:4")
    assert call("import", "images", tmp_path / "drive.avi", "-o", tmp_path / "bag", *words) == 0
    assert np.diff(headers(tmp_path / "bag")["image_raw"]).tolist() == [40_000_000] * 2


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "images: expected --rig, --camera (one camera, with --baseline a rectified pair) or --baseline"),
        (("--baseline", "-1"), "--baseline: expected a positive length in m"),
        (("--baseline", "0.3"), "expected a folder top of images or a video top.mp4, found left, right"),
        (
            ("--camera", "300,300,159.5,119.5", "--baseline", "0.3"),
            "right: expected 1 images as of left, found 2 of right",
        ),
        (("--camera", "300,300,159.5,119.5"), "expected images, or one video, found left, right"),
    ],
)
def test_images_without_a_lens_a_base_line_or_a_partner_are_refused(capsys, tmp_path, words, expected):
    for side, number in (("left", 0), ("right", 0), ("right", 1)):
        write(tmp_path / "in" / side / f"{number}.png", wall(0.0))
    assert call("import", "images", tmp_path / "in", "-o", tmp_path / "bag", *words) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1
    assert expected in error[0]
