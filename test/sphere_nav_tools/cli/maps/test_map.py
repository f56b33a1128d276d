"""`sphere_nav map` and what reads its maps: map-info, map-verify, map-export, register."""

import json
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import Imu

from mcl_depth.geometry.ply import read_ply
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_map_id, read_tum
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import header
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.cli.register import describe_refusal, register_spheres
from worlds.commands import call
from worlds.localizer import make_map
from worlds.recordings import (
    BASELINE,
    CAMERA,
    FIRST,
    ROOM,
    T_BASE_CAMERA,
    mount,
    pose,
    rgbd,
    sphere,
    stamp,
    stereo,
    truth,
    truth_of_base,
    write_bag,
)
from worlds.room import optical, wide_room

NUM_FRAMES = 6


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    numbers = range(NUM_FRAMES)
    return {
        "rgbd": write_bag(folder / "rgbd", rgbd, truth, numbers=numbers),
        "stereo": write_bag(folder / "stereo", stereo, truth, numbers=numbers),
        "sphere": write_bag(folder / "sphere", sphere, truth_of_base, numbers=numbers),
        "bare": write_bag(folder / "bare", truth, numbers=numbers),
    }


@pytest.fixture(scope="module")
def room_map(bags, tmp_path_factory):
    output = tmp_path_factory.mktemp("maps") / "room"
    words = ["map", bags["rgbd"], "-o", output, "--anchor", "truth", "--set", "mapper.key.max_parallax=0.02"]
    assert call(*words) == 0
    return output


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "limit"), [("rgbd", 0.005), ("stereo", 0.05), ("sphere", 0.005)])
def test_a_drive_is_mapped_from_every_kind_of_input(kind, limit, bags, tmp_path, capsys):
    assert call("map", bags[kind], "-o", tmp_path / "m", "--anchor", "truth", "--trajectory", tmp_path / "t.tum") == 0
    said = capsys.readouterr().out
    assert f"{NUM_FRAMES} spheres placed, 0 lost" in said
    poses = read_tum(tmp_path / "t.tum")
    for number in range(NUM_FRAMES):
        assert poses.T_map_body[number].distance(pose(number))[0] < limit
    with open_map(tmp_path / "m") as reader:
        first = reader.graph[0].T_map_sphere
        assert read_map_id(tmp_path / "t.tum") == reader.info.map_id
    assert first.distance(FIRST)[0] < limit  # fitted to the truth of the camera, also where that of the base is told


R_LEVEL_BASE = SE3.from_angles(0.03, -0.05, 0.0, np.zeros(3)).rotation


@pytest.fixture(scope="module")
def leaning(tmp_path_factory):
    """A map of a leaning vehicle, whose mounts and gravity the bag tells after its first image; what was said."""
    folder = tmp_path_factory.mktemp("leaning")
    with BagWriter(folder / "bag") as bag:
        for number in range(3):
            for topic, message in rgbd(number):
                bag.write(topic, message, stamp(number))
        bag.write("/tf_static", mount(), stamp(2) + 1)
        for number in range(20):
            message = Imu(header=header(stamp(0) + number * 10_000_000, "base_link"))
            vector = message.linear_acceleration
            vector.x, vector.y, vector.z = map(float, 9.8 * R_LEVEL_BASE[2])
            bag.write("/imu/data", message, stamp(0) + 1 + number * 10_000_000)
    with redirect_stdout(StringIO()) as said:
        words = ("--taught", folder / "t.tum", "--trajectory", folder / "c.tum", "--experience", "dusk")
        assert call("map", folder / "bag", "-o", folder / "map", *words) == 0
    return folder, said.getvalue().splitlines()


def test_a_leaning_vehicle_begins_where_gravity_has_it(leaning):
    folder, said = leaning
    first = read_tum(folder / "t.tum").T_map_body[0]
    np.testing.assert_allclose(first.matrix, SE3.from_parts(R_LEVEL_BASE, np.zeros(3)).matrix, atol=1e-6)
    assert said[-1].endswith("MB; its frame: base_link at the first sphere, level by gravity (IMU at rest)")


def test_a_map_tells_its_drive_and_holds_what_was_driven(leaning, capsys):
    folder, said = leaning
    assert call("map", folder / "bag", "-o", folder / "map") == 2
    assert "found a map: nothing is overwritten without --overwrite" in capsys.readouterr().err
    assert said[0].startswith("3 spheres placed, 0 lost, 1 kept, 0 loops closed")
    base, camera = (read_tum(folder / name).T_map_body for name in ("t.tum", "c.tum"))
    np.testing.assert_allclose((base @ T_BASE_CAMERA).matrix, camera.matrix, atol=1e-6)
    with open_map(folder / "map") as reader:
        (node,) = reader.graph
        assert (node.experience.name, node.experience.drive, reader.info.source) == ("dusk", "bag", "bag")
        np.testing.assert_allclose(node.T_map_sphere.translation, camera[0].translation, atol=1e-6)


def test_map_verify_finds_a_flipped_byte(room_map, tmp_path, capsys):
    assert call("map-verify", room_map) == 0
    assert "0 problems" in capsys.readouterr().out
    broken = tmp_path / "broken"
    broken.mkdir()
    for file in room_map.iterdir():
        (broken / file.name).write_bytes(file.read_bytes())
    data = bytearray((broken / "map.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    (broken / "map.mcap").write_bytes(data)
    assert call("map-verify", broken) in (1, 2)
    assert call("map-verify", tmp_path / "none") == 2


def test_exported_points_lie_on_the_walls(room_map, tmp_path):
    assert call("map-export", room_map, "-o", tmp_path / "room.ply", "--step", 8) == 0
    data = (tmp_path / "room.ply").read_bytes()
    head, _, body = data.partition(b"end_header\n")
    kind = [("xyz", "<f4", 3), ("rgb", "u1", 3)]
    points = np.frombuffer(body, kind)
    assert f"element vertex {len(points)}".encode() in head
    assert len(points) > 300
    on_wall = np.max(np.abs(points["xyz"]) / ROOM.half, axis=1)  # the map frame is that of the truth, the room's
    assert np.percentile(np.abs(on_wall - 1), 95) < 0.02
    read, _ = read_ply(tmp_path / "room.ply")  # the reader of mcl_depth
    np.testing.assert_array_equal(read.astype(np.float32), points["xyz"])


def registered(capsys, *words):
    status = call("register", *words)
    return status, json.loads(capsys.readouterr().out)


def motion_of(found):
    return SE3(np.array(found["T_a_b"]["matrix"]))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "limit"), [("stereo", 0.04), ("sphere", 0.005)])
def test_two_instants_of_a_bag_are_registered(kind, limit, bags, capsys):
    status, found = registered(capsys, f"{bags[kind]}:0", f"{bags[kind]}:2")
    assert status == 0
    assert found["is_converged"]
    assert motion_of(found).distance(pose(0).inverse() @ pose(2))[0] < limit
    assert 0.0 < found["residual"]["mad"] < 10.0
    assert np.all(np.linalg.eigvalsh(np.array(found["covariance"])) > 0)


def files(folder, number):
    image, depth_m = ROOM.rgbd(CAMERA, optical(pose(number)))
    right, _ = ROOM.rgbd(CAMERA, optical(pose(number)) @ SE3.from_parts(np.eye(3), [BASELINE, 0, 0]))
    cv2.imwrite(str(folder / f"i{number}.png"), image)
    cv2.imwrite(str(folder / f"r{number}.png"), right)
    cv2.imwrite(str(folder / f"d{number}.png"), np.rint(depth_m * 1000).astype(np.uint16))
    np.save(folder / f"d{number}.npy", depth_m)


@pytest.mark.parametrize(
    ("second", "options", "limit"), [("d{}.npy", (), 0.005), ("r{}.png", ("--baseline", BASELINE), 0.04)]
)
def test_two_pairs_of_files_are_registered(second, options, limit, tmp_path, capsys):
    for number in (0, 2):
        files(tmp_path, number)
    a, b = (f"{tmp_path}/i{number}.png,{tmp_path}/{second.format(number)}" for number in (0, 2))
    camera = ",".join(str(value) for value in (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy))
    status, found = registered(capsys, a, b, "--camera", camera, *options)
    assert status == 0
    assert motion_of(found).distance(pose(0).inverse() @ pose(2))[0] < limit
    angle = motion_of(found).distance(SE3.identity())[1]
    assert found["T_a_b"]["angle_deg"] == pytest.approx(np.degrees(angle), rel=1e-3)


def test_a_pair_that_cannot_be_one_is_refused_in_a_line(tmp_path, capsys):
    for number in (0, 2):
        files(tmp_path, number)
    cv2.imwrite(str(tmp_path / "i2.png"), np.full((CAMERA.height, CAMERA.width), 90, np.uint8))
    a, b = (f"{tmp_path}/i{number}.png,{tmp_path}/d{number}.npy" for number in (0, 2))
    camera = ",".join(str(value) for value in (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy))
    assert call("register", a, b, "--camera", camera) == 1
    captured = capsys.readouterr()
    assert not json.loads(captured.out)["is_converged"]
    assert captured.err.startswith(f"sphere_nav register: {b}: refused (")


@pytest.mark.slow
def test_a_motion_may_be_large_and_a_wrong_one_is_not_converged():
    T = SE3.from_planar(1.2, -0.7, 1.3)
    a, b = (node.sphere for node in make_map(wide_room(), [SE3.identity(), T]).graph)
    found = register_spheres(a, b, SE3.identity())
    assert found.is_converged
    assert found.T_a_b.translation == pytest.approx(T.translation, abs=0.01)
    wrong = replace(b, range_m=(2.0 * b.range_m).astype(np.float32))
    refused = register_spheres(a, wrong, SE3.identity())
    assert not refused.is_converged
    assert refused.reason
    assert "odometry" in describe_refusal(refused.reason)
    assert describe_refusal("ONE_WAY").startswith("refused (ONE_WAY): the way back disagrees; smaller steps")
