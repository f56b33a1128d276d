"""What the pages for one's own recording, camera and rig tell to type works, on bags of another writer."""

import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav_tools.cli.main import main
from worlds.recordings import CAMERA, FRAME, ROOM, optical, pose, stamp
from worlds.rig import seen, vertical_rig

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = ("your_recording", "your_camera", "calibration", "on_a_vehicle", "something_is_wrong")
STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
NUM_INSTANTS = 6
CAMCHAIN = {
    f"cam{n}": {"camera_model": "pinhole", "intrinsics": [500.0, 500.0, 320.0, 240.0], "resolution": [640, 480]}
    | ({"T_cn_cnm1": [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]} if n else {})
    for n in range(2)
}


def commands(page: str) -> list[list[str]]:
    """Return the words of every line of the fenced blocks; a line that ends in a backslash goes on."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^ *```\n(.*?)^ *```$", text, re.DOTALL | re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.strip()]


class Recorder:
    """Writes by `rosbags` alone, message by message."""

    def __init__(self, path: Path, storage: StoragePlugin) -> None:
        self.writer = Writer(path, version=8, storage_plugin=storage)
        self.connections: dict[str, object] = {}

    def __enter__(self) -> "Recorder":
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def write(self, topic: str, message: object, ns: int) -> None:
        kind = message.__msgtype__  # type: ignore[attr-defined]
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=STORE)
        self.writer.write(self.connections[topic], ns, STORE.serialize_cdr(message, kind))


def header(ns: int, frame: str) -> object:
    time = TYPES["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
    return TYPES["std_msgs/msg/Header"](time, frame)


def image(pixels: np.ndarray, ns: int, frame: str, encoding: str) -> object:
    data = np.ascontiguousarray(pixels)
    height, width = data.shape[:2]
    kind = TYPES["sensor_msgs/msg/Image"]
    return kind(header(ns, frame), height, width, encoding, 0, data.strides[0], data.view(np.uint8).ravel())


def info(ns: int) -> object:
    fx, fy, cx, cy = CAMERA.coefficients[:4]
    roi = TYPES["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    K = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1])
    P = np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0])
    size = (CAMERA.height, CAMERA.width)
    kind = TYPES["sensor_msgs/msg/CameraInfo"]
    return kind(header(ns, FRAME), *size, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), P, 0, 0, roi)


def odometry(number: int) -> object:
    T = pose(number)
    point = TYPES["geometry_msgs/msg/Point"](*T.translation.tolist())
    turn = TYPES["geometry_msgs/msg/Quaternion"](*T.quaternion.tolist())
    place = TYPES["geometry_msgs/msg/PoseWithCovariance"](TYPES["geometry_msgs/msg/Pose"](point, turn), np.zeros(36))
    zero = TYPES["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = TYPES["geometry_msgs/msg/TwistWithCovariance"](TYPES["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36))
    return TYPES["nav_msgs/msg/Odometry"](header(stamp(number), "odom"), "base_link", place, twist)


def record_realsense(path: Path, storage: StoragePlugin, numbers: range) -> None:
    root = "/camera/camera"
    with Recorder(path, storage) as bag:
        for number in numbers:
            ns = stamp(number)
            gray, meters = ROOM.rgbd(CAMERA, optical(pose(number)))
            millimeters = np.nan_to_num(np.rint(meters * 1e3), nan=0, posinf=0).astype(np.uint16)
            bag.write(f"{root}/color/camera_info", info(ns), ns)
            bag.write(f"{root}/color/image_raw", image(np.dstack([gray] * 3), ns, FRAME, "rgb8"), ns + 1)
            bag.write(f"{root}/aligned_depth_to_color/image_raw", image(millimeters, ns, FRAME, "16UC1"), ns + 2)
            bag.write("/wheel/odometry", odometry(number), ns + 3)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A folder with what the pages speak of: recordings, a rig's recording, its file, a calibration of Kalibr."""
    folder = tmp_path_factory.mktemp("own")
    record_realsense(folder / "recording", StoragePlugin.SQLITE3, range(NUM_INSTANTS))
    record_realsense(folder / "second_recording", StoragePlugin.MCAP, range(NUM_INSTANTS))
    rig = vertical_rig()
    write_rig(folder / "rig.yaml", rig)
    (folder / "camchain.yaml").write_text(yaml.safe_dump(CAMCHAIN))
    with Recorder(folder / "six_cameras", StoragePlugin.SQLITE3) as bag:
        for number in range(2):
            for place, part in enumerate(rig.cameras):
                ns = stamp(number) + place
                bag.write(f"/cam{place}/image_raw", image(seen(part), ns, f"cam{place}", "mono8"), ns)
    save_images(folder / "six_folders", {part.name: seen(part) for part in rig.cameras})
    save_images(folder / "pair", dict.fromkeys(("left", "right"), np.full((370, 1226), 90, np.uint8)))
    save_images(folder / "panoramas", dict.fromkeys(("top", "bottom"), np.full((128, 256), 90, np.uint8)))
    return folder


def save_images(folder: Path, pictures: dict[str, np.ndarray]) -> None:
    """Write a folder for each camera, of two images by number."""
    for name, pixels in pictures.items():
        (folder / name).mkdir(parents=True)
        for number in range(2):
            assert cv2.imwrite(str(folder / name / f"{number:06d}.png"), pixels)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES[:3])
def test_the_commands_of_a_page_run_one_after_the_other(page, recordings, tmp_path, monkeypatch, capsys):
    for item in recordings.iterdir():
        (tmp_path / item.name).symlink_to(item)
    monkeypatch.chdir(tmp_path)
    own = [words[1:] for words in commands(page) if words[0] == "sphere_nav"]
    assert own
    for words in own:
        status = main(words)
        said = capsys.readouterr()
        assert status == 0, f"sphere_nav {' '.join(words)}: {said.err or said.out}"


def test_the_page_of_presets_names_all_of_them():
    text = (DOCS / "your_camera.md").read_text(encoding="utf-8")
    presets = {path.stem for path in (DOCS.parent / "config" / "cameras").glob("*.yaml")}
    table = "\n".join(line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))
    assert set(re.findall(r"`(\w+)`", table)) == presets
