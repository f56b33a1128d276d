"""What the pages for one's own recording, camera and rig tell to type works, on bags of another writer."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin
from sensor_msgs.msg import Image

from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.conversions import array_to_image, se3_to_odometry
from sphere_nav_tools.cli.main import main
from worlds.copies import REALSENSE, copy_bag
from worlds.recordings import pose, rgbd, stamp, write_bag
from worlds.rig import seen, vertical_rig

# a video of a board, and a map of the hall: rig_calibration and localize have tests of their own
NOT_HERE = ("calibrate board.mp4", "localize hall")
DOCS = Path(__file__).resolve().parents[2] / "docs"
NUM_INSTANTS = 6
CAMERA = {"camera_model": "pinhole", "intrinsics": [500.0, 500.0, 320.0, 240.0], "resolution": [640, 480]}
BESIDE = {"T_cn_cnm1": [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}


def commands(page: str) -> list[list[str]]:
    """Return the words of every line of the fenced blocks; a line that ends in a backslash goes on."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^ *```\n(.*?)^ *```$", text, re.DOTALL | re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.strip()]


def with_wheels(number):
    yield from (item for item in rgbd(number))
    yield "odom", se3_to_odometry(pose(number), np.zeros((6, 6)), stamp(number), ("odom", "base_link"), np.zeros(6))


def six_cameras(number):
    for place, part in enumerate(vertical_rig().cameras):
        yield f"cam{place}/image_raw", array_to_image(seen(part), stamp(number) + place, f"cam{place}", "mono8")


def save_images(folder: Path, pictures: dict[str, np.ndarray]) -> None:
    """Write a folder for each camera, of two images by number."""
    for name, pixels in pictures.items():
        (folder / name).mkdir(parents=True)
        for number in range(2):
            assert cv2.imwrite(str(folder / name / f"{number:06d}.png"), pixels)


def save_video(path: Path, picture: np.ndarray) -> None:
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, picture.shape[::-1])
    for _ in range(10):
        video.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    video.release()


def as_color(topic, message):
    if not isinstance(message, Image) or not topic.endswith("/color/image_raw"):
        return message
    return Image(header=message.header, height=message.height, width=message.width, encoding="rgb8",
                 step=3 * message.width, data=np.repeat(np.array(message.data), 3).tobytes())  # fmt: skip


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A folder with what the pages speak of: recordings, a rig's recording, its file, a calibration of Kalibr."""
    folder, source = tmp_path_factory.mktemp("own"), tmp_path_factory.mktemp("source")
    names = {ours: theirs for ours, theirs in REALSENSE.items() if ours != "/tf_static"} | {"/odom": "/wheel/odometry"}
    write_bag(source / "drive", with_wheels, numbers=range(NUM_INSTANTS))
    for name, storage in (("recording", StoragePlugin.SQLITE3), ("second_recording", StoragePlugin.MCAP)):
        copy_bag(source / "drive", folder / name, names, as_color, storage)
    rig = vertical_rig()
    write_rig(folder / "rig.yaml", rig)
    (folder / "camchain.yaml").write_text(yaml.safe_dump({"cam0": CAMERA, "cam1": CAMERA | BESIDE}))
    write_bag(source / "rig", six_cameras, numbers=range(2))
    topics = {f"/cam{k}/image_raw": f"/cam{k}/image_raw" for k in range(len(rig.cameras))}
    copy_bag(source / "rig", folder / "six_cameras", topics, storage=StoragePlugin.SQLITE3)
    save_images(folder / "six_folders", {part.name: seen(part) for part in rig.cameras})
    save_images(folder / "pair", dict.fromkeys(("left", "right"), np.full((370, 1226), 90, np.uint8)))
    phone = replace(rig.cameras[0], level="")
    write_rig(folder / "phone.yaml", replace(rig, cameras=(phone,)))
    save_video(folder / "phone.mp4", seen(phone))
    save_video(folder / "walk_360.mp4", np.full((128, 256), 90, np.uint8))
    save_images(folder / "panoramas", dict.fromkeys(("top", "bottom"), np.full((128, 256), 90, np.uint8)))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", ["your_recording", "your_camera", "calibration"])
def test_a_page_tells_no_command_that_fails(page, recordings, tmp_path, monkeypatch, capsys):
    for item in recordings.iterdir():
        (tmp_path / item.name).symlink_to(item)
    monkeypatch.chdir(tmp_path)
    own = [words[1:] for words in commands(page) if words[0] == "sphere_nav"]
    assert own
    for words in (words for words in own if not " ".join(words).startswith(NOT_HERE)):
        status = main(words)
        said = capsys.readouterr()
        assert status == 0, f"sphere_nav {' '.join(words)}: {said.err or said.out}"


def test_a_preset_that_is_not_on_its_page_is_not_found():
    text = (DOCS / "your_camera.md").read_text(encoding="utf-8")
    presets = {path.stem for path in (DOCS.parent / "config" / "cameras").glob("*.yaml")}
    table = "\n".join(line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))
    assert set(re.findall(r"`(\w+)`", table)) == presets
