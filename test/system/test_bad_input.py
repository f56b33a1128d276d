"""Bad input to the commands: one line with file, field, expected and found, status 2, nothing written."""

import shutil

import numpy as np
import pytest
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
    messages = wall_messages()
    for _, message, _ in messages:
        if isinstance(message, CameraInfo):
            for name, value in changes.items():
                setattr(message, name, value)
    return messages


def with_depth(value):
    pixels, depth_m = wall()
    depth = FRAMES.depth(np.full_like(depth_m, value), SECOND)
    return [FRAMES.mount(SECOND), FRAMES.info(SECOND), depth, FRAMES.image(pixels, SECOND)]


BAGS = {
    "good": wall_messages,
    "empty": list,
    "no_depth": lambda: without("/depth/image_raw"),
    "no_images": lambda: without("/image_raw"),
    "no_info": lambda: without("/camera_info"),
    "no_truth": lambda: without("/ground_truth/pose"),
    "other_size": lambda: with_info(width=320, height=240, k=[200.0, 0.0, 159.5, 0.0, 200.0, 119.5, 0.0, 0.0, 1.0]),
    "no_focal_length": lambda: with_info(k=[0.0] * 9),
    "nan_depth": lambda: with_depth(np.nan),
}
NO_BAGS = {
    "absent": ("expected a", "found none"),
    "empty": ("expected messages", "found an empty bag"),
    "truncated": ("mcap: truncated MCAP: ", "saves what is readable"),
}
NO_POSES = {
    "no_images": ("expected", "image_raw", "found"),
    "no_info": ("expected", "camera_info", "found"),
    "other_size": ("expected one topic with camera_info of /image_raw (160 x 120), found /camera_info (320 x 240)",),
    "no_focal_length": ("camera_optical: K[0]: expected a calibrated camera, found focal length 0",),
}
NO_RANGE = {
    "no_depth": ("topic", "expected", "/image_raw"),
    "nan_depth": ("/depth/image_raw (range or depth: expected some measured pixels, found none)",),
}
NO_MAPS = {
    "absent": ("absent", "expected", "found none"),
    "empty_map": ("map.mcap", "expected a map", "found no such file"),
    "truncated_map": ("map.mcap: truncated MCAP: ", "saves what is readable"),
    "future_map": ("format_version: expected 1, found 2",),
    "good": ("map.mcap", "expected a map", "found no such file"),  # a bag, but no map
}
COMMANDS = {  # what takes the input in question, and what may be wrong with it
    "map {} -o out": NO_BAGS | NO_POSES | NO_RANGE,
    "localize map {} -o out.tum --bag out --json out.json": NO_BAGS | NO_POSES,
    "evaluate good {} --poses-topic /ground_truth/pose --json out.json": NO_BAGS
    | {"no_truth": ("expected topic /ground_truth/pose, found /camera_info",)},
    "play {}": NO_BAGS,
    "register {} good": {"absent": ("expected",), "no_depth": ("expected",)},
    "localize {} good -o out.tum": NO_MAPS,
    "map-info {}": NO_MAPS,
    "map-export {} -o out.ply": NO_MAPS,
    "map good -o out --set {}": {
        "mapper.nothing=1": ("mapper.nothing: unknown parameter",),
        "mapper.num_references=9": ("expected 1 to 4, found 9",),
        "word": ("--set: expected NAME=VALUE, found 'word'",),
    },
    "localize map good -o out.tum {}": {
        "--initial-pose=90,0,0,0,0,0,1": ("initial pose: expected at most 10 m from a key sphere, found 90.0 m",),
        "--image=/front/image_raw": ("expected topic /front/image_raw",),
    },
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
    with BagReader(folder / "map") as bag, BagWriter(folder / "future_map", file_name="map.mcap") as writer:
        for topic, stamp, message in bag.messages():
            if isinstance(message, MapInfo):
                message.format_version = MapInfo.FORMAT_VERSION + 1
            writer.write(topic, message, stamp)
    (folder / "empty_map").mkdir()
    return folder


def snapshot(folder):
    return {path: (path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(folder.rglob("*"))}


@pytest.mark.slow
@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_refuses_in_one_line_and_writes_nothing(line, inputs, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    before = snapshot(inputs)
    for name, parts in COMMANDS[line].items():
        words = [word.format(name) for word in line.split()]
        is_input = {*BAGS, *NO_BAGS, *NO_MAPS, "map"}
        capfd.readouterr()
        status = main([words[0], *(str(inputs / word) if word in is_input else word for word in words[1:])])
        out, err = capfd.readouterr()
        said = [text for text in err.splitlines() if text.strip() and "%|" not in text and "it/s" not in text]
        assert (status, len(said)) == (2, 1), (name, status, out, err)
        own = "[bag_player]: cannot start: " if words[0] == "play" else f"sphere_nav {words[0]}: "  # a node logs
        wanted = [own, *parts, *([name] if name in is_input and name != "map" else [])]
        assert [part for part in wanted if part not in said[0]] == [], (name, said)
        assert "Traceback" not in out + err
        assert (list(tmp_path.iterdir()), snapshot(inputs)) == ([], before), name


@pytest.mark.slow
def test_half_of_the_depth_unknown_is_no_reason_to_lose_a_drive(tmp_path, capsys):
    messages = []
    _, depth_m = wall()
    depth_m[:, ::2] = np.nan
    for topic, message, stamp in wall_messages():
        messages.append(FRAMES.depth(depth_m, stamp) if topic == "/depth/image_raw" else (topic, message, stamp))
    write_bag(tmp_path / "bag", messages)
    assert main(["map", str(tmp_path / "bag"), "-o", str(tmp_path / "map")]) == 0
    assert "3 spheres placed, 0 lost" in capsys.readouterr().out
