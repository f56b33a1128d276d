"""Bad input to the commands: one line with file, field, expected and found, status 2, nothing written."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from mcap.reader import make_reader
from sensor_msgs.msg import CameraInfo
from sphere_nav_msgs.msg import MapInfo

from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav_tools.cli.main import main

from .conftest import SECOND, SMALL, Frames, wall, wall_messages, write_bag

FRAMES = Frames(SMALL)
TRUNCATED = 0.6  # share of the file that is left


def without(topic):
    return [item for item in wall_messages() if item[0] != topic]


def with_info(**changes):
    """The recording with another CameraInfo."""
    messages = wall_messages()
    for _, message, _ in messages:
        if isinstance(message, CameraInfo):
            for name, value in changes.items():
                setattr(message, name, value)
    return messages


def with_depth(value):
    pixels, depth_m = wall()
    stamp = SECOND
    return [
        FRAMES.mount(stamp),
        FRAMES.info(stamp),
        FRAMES.depth(np.full_like(depth_m, value), stamp),
        FRAMES.image(pixels, stamp),
    ]


UNCALIBRATED = [0.0] * 9
FOLDER_FAULTS = {  # of any folder that should be a bag or a map
    "absent": ("expected a", "found none"),
    "empty": ("expected messages", "found an empty bag"),
    "truncated": ("mcap: truncated MCAP: ", "can be salvaged"),
}
BAGS = {
    "good": wall_messages,
    "empty": list,
    "no_depth": lambda: without("/depth/image_raw"),
    "no_images": lambda: without("/image_raw"),
    "no_info": lambda: without("/camera_info"),
    "no_truth": lambda: without("/ground_truth/pose"),
    "other_size": lambda: with_info(width=320, height=240),
    "no_focal_length": lambda: with_info(k=UNCALIBRATED),
    "nan_depth": lambda: with_depth(np.nan),
    "zero_depth": lambda: with_depth(0.0),
}
EXPECTED = {
    "no_depth": ("topic", "expected", "/image_raw"),
    "no_images": ("expected", "image_raw", "found"),
    "no_info": ("expected", "camera_info", "found"),
    "other_size": ("/image_raw: image size: expected 320 x 240 (/camera_info), found 160 x 120",),
    "no_focal_length": ("camera_optical: K[0]: expected a calibrated camera, found focal length 0",),
    "nan_depth": ("/depth/image_raw (range or depth: expected some measured pixels, found none)",),
    "zero_depth": ("/depth/image_raw (range or depth: expected some measured pixels, found none)",),
}


@pytest.fixture(scope="session")
def inputs(tmp_path_factory):
    """Every bag of the table by name, a good map, and damaged copies of both; nothing of it is ever changed."""
    folder = tmp_path_factory.mktemp("inputs")
    for name, make in BAGS.items():
        write_bag(folder / name, make())
    assert main(["map", str(folder / "good"), "-o", str(folder / "map")]) == 0
    for source, target in (("good", "truncated"), ("map", "truncated_map")):
        shutil.copytree(folder / source, folder / target)
        file = next((folder / target).glob("*.mcap"))
        file.write_bytes(file.read_bytes()[: int(TRUNCATED * file.stat().st_size)])
    of_another_version(folder / "map", folder / "future_map")
    (folder / "empty_map").mkdir()
    return folder


def of_another_version(source: Path, target: Path) -> None:
    """Copy a map, the format version raised by one."""
    with BagReader(source) as bag, BagWriter(target, file_name="map.mcap") as writer:
        for topic, stamp, message in bag.messages():
            if isinstance(message, MapInfo):
                message.format_version = MapInfo.FORMAT_VERSION + 1
            writer.write(topic, message, stamp)


@pytest.fixture
def refusal(inputs, tmp_path, monkeypatch, capfd):
    """Run a command in an empty folder; return its one line, after checking that there is no other and no new file."""
    monkeypatch.chdir(tmp_path)
    before = snapshot(inputs)

    def run(*words):
        capfd.readouterr()
        status = main([*map(str, words)])
        out, err = capfd.readouterr()
        lines = [line for line in err.splitlines() if line.strip() and "%|" not in line and "it/s" not in line]
        assert status == 2, (status, out, err)
        assert len(lines) == 1, err
        own = "[bag_player]: cannot start: " if words[0] == "play" else f"sphere_nav {words[0]}: "  # a node logs
        assert own in lines[0]
        assert "Traceback" not in out + err
        assert sorted(path.name for path in tmp_path.iterdir()) == []
        assert snapshot(inputs) == before
        return lines[0]

    return run


def snapshot(folder):
    return {path: (path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(folder.rglob("*"))}


def holds(line, *parts):
    for part in parts:
        assert part in line


@pytest.mark.slow
@pytest.mark.parametrize("fault", FOLDER_FAULTS)
@pytest.mark.parametrize("command", ["map", "localize", "evaluate", "play", "verify-bag"])
def test_no_readable_bag(refusal, inputs, command, fault):
    if (command, fault) == ("verify-bag", "empty"):
        assert main([command, str(inputs / fault)]) == 1  # it has done its work: there is a problem
        return
    words = {
        "map": [inputs / fault, "-o", "out"],
        "localize": [inputs / "map", inputs / fault, "-o", "out.tum"],
        "evaluate": [inputs / "good", inputs / fault, "--poses-topic", "/ground_truth/pose", "--json", "out.json"],
    }.get(command, [inputs / fault])
    holds(refusal(command, *words), str(inputs / fault), *FOLDER_FAULTS[fault])


@pytest.mark.slow
@pytest.mark.parametrize("fault", EXPECTED)
def test_no_map_of_a_bad_recording(refusal, inputs, fault):
    holds(refusal("map", inputs / fault, "-o", "out"), str(inputs / fault), *EXPECTED[fault])


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["no_images", "no_info", "other_size", "no_focal_length"])
def test_no_poses_from_a_bad_recording(refusal, inputs, fault):
    line = refusal("localize", inputs / "map", inputs / fault, "-o", "out.tum", "--bag", "out", "--json", "out.json")
    holds(line, str(inputs / fault), *EXPECTED[fault])


MAP_FAULTS = {
    "absent": ("absent", "expected", "found none"),
    "empty_map": ("map.mcap", "expected a map", "found no such file"),
    "truncated_map": ("map.mcap: truncated MCAP: ", "can be salvaged"),
    "future_map": ("format_version: expected 1, found 2",),
    "good": ("map.mcap", "expected a map", "found no such file"),  # a bag, but no map
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", MAP_FAULTS)
@pytest.mark.parametrize("command", ["localize", "map-info", "map-export"])
def test_no_readable_map(refusal, inputs, command, fault):
    words = {
        "localize": [inputs / fault, inputs / "good", "-o", "out.tum"],
        "map-info": [inputs / fault],
        "map-export": [inputs / fault, "-o", "out.ply"],
    }
    holds(refusal(command, *words[command]), str(inputs / fault), *MAP_FAULTS[fault])


@pytest.mark.slow
def test_evaluate_without_truth(refusal, inputs):
    line = refusal("evaluate", inputs / "good", inputs / "no_truth", "--poses-topic", "/ground_truth/pose")
    holds(line, str(inputs / "no_truth"), "expected topic /ground_truth/pose, found /camera_info")


@pytest.mark.slow
def test_evaluate_files(refusal, inputs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("poses")
    (folder / "short.tum").write_text("1.0 0 0 0\n")
    (folder / "nan.tum").write_text("1.0 nan 0 0 0 0 0 1\n")
    (folder / "none.tum").write_text("")
    for name in ("absent.tum", "short.tum", "nan.tum", "none.tum"):
        holds(refusal("evaluate", folder / name, inputs / "good", "--plot", "out.png"), str(folder / name))


@pytest.mark.slow
def test_import(refusal, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    holds(
        refusal("import", "seven_scenes", folder / "absent", "-o", "out"), str(folder / "absent"), "expected", "found"
    )
    holds(refusal("import", "kitti", folder, "-o", "out"), str(folder), "expected", "found")
    for kind, pixels in (("color", np.zeros((480, 640, 3), np.uint8)), ("depth", np.zeros((480, 640), np.uint16))):
        cv2.imwrite(str(folder / f"frame-000000.{kind}.png"), pixels)
    np.savetxt(folder / "frame-000000.pose.txt", np.full((4, 4), np.nan))
    line = refusal("import", "seven_scenes", folder, "-o", "out")
    holds(line, str(folder / "frame-000000.pose.txt"), "expected", "found")
    np.savetxt(folder / "frame-000000.pose.txt", np.eye(4))
    cv2.imwrite(str(folder / "frame-000000.color.png"), np.zeros((120, 160, 3), np.uint8))
    line = refusal("import", "seven_scenes", folder, "-o", "out")
    holds(line, str(folder / "frame-000000.color.png"), "expected", "640", "found", "160")
    (folder / "frame-000000.depth.png").write_bytes(b"\x89PNG")
    holds(refusal("import", "seven_scenes", folder, "-o", "out", "--registered"), str(folder), "expected", "found")


@pytest.mark.slow
def test_play_without_the_topic(refusal, inputs):
    line = refusal("play", inputs / "good", "--topics", "/left/image_raw")
    holds(line, str(inputs / "good"), "expected topic /left/image_raw, found /camera_info")


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["absent", "truncated", "no_depth", "no_focal_length"])
def test_register_without_a_readable_reference(refusal, inputs, fault):
    holds(refusal("register", inputs / fault, inputs / "good", "--json", "out.json"), str(inputs / fault), "expected")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["import", "map", "localize"])
def test_nothing_is_overwritten(inputs, command, tmp_path, capsys):
    target = tmp_path / "mine"
    target.mkdir() if command != "localize" else target.write_text("kept")
    words = {
        "import": ["seven_scenes", inputs, "-o", target],
        "map": [inputs / "good", "-o", target],
        "localize": [inputs / "map", inputs / "good", "-o", target],
    }
    assert main([command, *map(str, words[command])]) == 2
    assert "mine: expected no such file" in capsys.readouterr().err or command == "import"
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert list(target.iterdir()) == [] if target.is_dir() else target.read_text() == "kept"


def test_unknown_depth_is_no_error(tmp_path, capsys):
    """NaN is 'not measured': a recording with half of its depth unknown is mapped."""
    messages = []
    _, depth_m = wall()
    depth_m[:, ::2] = np.nan
    for topic, message, stamp in wall_messages():
        messages.append(FRAMES.depth(depth_m, stamp) if topic == "/depth/image_raw" else (topic, message, stamp))
    write_bag(tmp_path / "bag", messages)
    assert main(["map", str(tmp_path / "bag"), "-o", str(tmp_path / "map")]) == 0
    assert "3 spheres placed, 0 lost" in capsys.readouterr().out
    with (tmp_path / "map" / "map.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    count = summary.statistics.channel_message_counts
    found = {channel.topic: count.get(number, 0) for number, channel in summary.channels.items()}
    one_sphere = {"/map/sphere": 1, "/map/coarse_sphere": 1, "/map/features": 1, "/map/experience": 1}
    assert found.items() >= one_sphere.items()
