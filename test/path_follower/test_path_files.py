"""Trajectories in files: there and back, and what is wrong with a file."""

import json

import numpy as np
import pytest

from path_follower.params import FollowerParams, PathFollowerParams
from path_follower.path_files import read_path
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, write_tum

PARAMS = FollowerParams()


def test_a_taught_drive_has_headings_and_speeds(kit, tmp_path):
    poses = kit.course((10, 0), (6, 0.2))
    tangent = SE3.from_parts(
        SE3.exp(np.column_stack([np.zeros((len(poses), 5)), poses[:, 2]])).rotation,
        np.column_stack([poses[:, :2], np.zeros(len(poses))]),
    )
    stamps = (np.arange(len(poses)) * 0.05 / 0.8 * 1e9).astype(np.int64) + 10**9
    write_tum(tmp_path / "taught.tum", Trajectory(stamps, tangent))
    assert read_path(tmp_path / "taught.tum", PARAMS).map_id == ""
    write_tum(tmp_path / "taught.tum", Trajectory(stamps, tangent), map_id="yard")
    path = read_path(tmp_path / "taught.tum", PARAMS)
    assert path.map_id == "yard"
    assert path.length == pytest.approx(16.0, abs=0.03)
    assert path.speed.max() == pytest.approx(0.8, rel=0.02)


def test_columns_go_by_name_or_by_the_usual_order(tmp_path):
    for text in [
        "0,0\n1,0\n2,0\n",
        "x,y\n0,0\n1,0\n2,0\n",
        "# made by hand, in a hurry\n\n0,0,0,1.0\n1,0,0,1.0\n2,0,0,1.0\n",
        "y,x,yaw\n0,0,0\n0,1,0\n0,2,0\n",
        "# map_id: yard\ny,x,yaw\n0,0,0\n0,1,0\n0,2,0\n",
    ]:
        (tmp_path / "path.csv").write_text(text)
        path = read_path(tmp_path / "path.csv", PARAMS)
        assert path.length == pytest.approx(2.0, abs=1e-6)
        assert path.x[-1] == pytest.approx(2.0, abs=1e-6)
        assert path.map_id == ("yard" if "yard" in text else "")


WEST = [(-0.5 * i, 0.0) for i in range(12)]


def test_a_drive_in_a_file_without_orientations_is_forward(tmp_path):
    xyz = np.array([(x, y, 0.0) for x, y in WEST])
    stamps = (np.arange(12) + 1) * 10**9
    write_tum(tmp_path / "gps.tum", Trajectory(stamps, SE3.from_parts(np.broadcast_to(np.eye(3), (12, 3, 3)), xyz)))
    assert read_path(tmp_path / "gps.tum", PARAMS).segments[0].direction == 1


def test_a_wrong_file_is_refused_with_file_line_and_field(tmp_path):
    columns = r"path\.csv:1: expected columns x, y, yaw, speed, found "
    seconds = r"ns\.tum:1: stamp: expected seconds from 0 to 2\^31, .* \(nanoseconds\?\)"
    for name, text, message in [
        ("path.csv", "time,x,y\n0,0,3\n1,1,3\n", f"{columns}'time, x, y'"),
        ("path.csv", "lat,lon\n0,0\n1,0\n", f"{columns}'lat, lon'"),
        ("path.csv", "x,y,yaw_deg\n0,0,0\n1,0,0\n", f"{columns}'x, y, yaw_deg'"),
        ("path.csv", "x,y,x\n0,0,0\n", f"{columns}'x, y, x'"),
        ("path.csv", "x,y\n0,5,3,0\n1,5,3,0\n", r"path\.csv:2: expected 2 columns, found 4: decimal commas\?"),
        ("path.csv", "0,0\n1,nan\n", r"path\.csv:2: y: expected a finite number, found 'nan'"),
        ("path.csv", "0,0\n0,0\n", r"path\.csv: path: expected a length of 0\.2 to 100000 m, found 0 m"),
        ("path.json", "", r"path\.json: expected a \.csv, \.tum or \.yaml file, found \.json"),
        ("ns.tum", "1700000000000000000 0 0 0 0 0 0 1\n1700000001000000000 1 0 0 0 0 0 1\n", seconds),
    ]:
        (tmp_path / name).write_text(text)
        with pytest.raises(ValueError, match=message) as caught:
            read_path(tmp_path / name, PARAMS)
        assert "\n" not in str(caught.value)


def echo(points, turns, frames=("map",)):
    """A nav_msgs/Path as `ros2 topic echo` writes it, as far as it is read."""
    poses = [
        {
            "header": {"frame_id": frames[min(i, len(frames) - 1)]},
            "pose": {"position": {"x": x, "y": y, "z": 0}, "orientation": dict(zip("xyzw", turn, strict=True))},
        }
        for i, ((x, y), turn) in enumerate(zip(points, turns, strict=True))
    ]
    return {"header": {"frame_id": "map"}, "poses": poses}


IDENTITY, UNSET, BACK_TURN = (0, 0, 0, 1), (0, 0, 0, 0), (0, 0, 1, 0)


def test_orientations_that_were_never_filled_in_are_no_headings(tmp_path):
    ways = {"west": WEST, "north": [(0.0, -x) for x, _ in WEST], "bend": [(x, 0.1 * x * x) for x, _ in WEST]}
    for points in ways.values():
        for turn in (IDENTITY, UNSET):
            for start, goal in [(turn, turn), (turn, (0, 0, 0.6, 0.8)), ((0, 0, 0.6, 0.8), BACK_TURN)]:
                file = tmp_path / "path.yaml"
                file.write_text(json.dumps(echo(points, [start, *[turn] * 10, goal])))
                path = read_path(file, PathFollowerParams())
                assert [segment.direction for segment in path.segments] == [1]
    file.write_text(json.dumps(echo(WEST, [(0, 0, 1e-3, 1)] * 12)))
    assert read_path(file, PathFollowerParams()).segments[0].direction == -1  # told, and it fits


def test_a_pose_of_another_frame_than_its_path_is_refused(tmp_path):
    file = tmp_path / "path.yaml"
    file.write_text(json.dumps(echo(WEST, [IDENTITY] * 12, ("/map", "map", "odom"))))
    with pytest.raises(ValueError, match=r"poses\[2\].header.frame_id: expected 'map', that of the path, found 'odom'"):
        read_path(file, PathFollowerParams())


PATH = """\
header: {stamp: {sec: 0, nanosec: 0}, frame_id: map}
poses:
- pose: {position: {x: 0.0, y: 1.0, z: 0.0}, orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}}
- pose: {position: {x: 2.0, y: 1.0, z: 0.0}, orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}}
- pose: {position: {x: 1.0, y: 1.0, z: 0.0}, orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}}
---
"""


def test_yaml_holds_a_path_as_it_is_echoed(tmp_path):
    (tmp_path / "path.yaml").write_text(PATH)
    path = read_path(tmp_path / "path.yaml", PathFollowerParams())
    assert [segment.direction for segment in path.segments] == [1, -1]
    assert path.y == pytest.approx(1.0)
    (tmp_path / "path.yaml").write_text(PATH.replace("---", "- '...'\n---"))
    with pytest.raises(ValueError, match=r"path\.yaml: poses: .* cut by ros2 topic echo: use --full-length"):
        read_path(tmp_path / "path.yaml", PathFollowerParams())
