"""`sphere_nav mcl`: panoramas of a furnished room against its bare walls, offline, from nowhere."""

import json

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image
from sphere_nav_msgs.msg import SphereInfo
from tf2_msgs.msg import TFMessage

from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros import qos
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_sphere_info, se3_to_odometry, se3_to_transform
from sphere_nav_tools.cli.main import main
from worlds.mcl import BOXES, COLUMNS, HEIGHT, SECOND, SETTINGS

YAWS = np.radians(2.0 * np.arange(12))  # whole columns of the panorama
POSES = [SE3.from_planar(-2.4 + 0.3 * k, -0.9 + 0.03 * k * k, float(yaw)) for k, yaw in enumerate(YAWS)]
TUNED = [word for name, value in SETTINGS.items() for word in ("--set", f"{name}={value}")]


def write_room(path):
    vertices, faces = [], []
    for low, high in BOXES:
        first = len(vertices)
        x, y, z = zip(low, high, strict=True)
        vertices += [f"{a} {b} {c}" for a in x for b in y for c in z]
        quads = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
        faces += ["4 " + " ".join(str(first + corner) for corner in quad) for quad in quads]
    header = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*header, *vertices, *faces]) + "\n")


def pictures(path):
    """Yield what a panoramic camera sees: nearer surfaces are brighter, with a little noise."""
    synthesizer = DepthSynthesizer(read_geometry(path), SynthesisParams(num_columns=COLUMNS))
    rng = np.random.default_rng(4)
    for pose in POSES:
        depth = synthesizer.synthesize_many([[*pose.translation[:2], HEIGHT]])[0]
        bright = np.roll(255.0 / (1.0 + 0.3 * depth), round(float(pose.yaw) / (2 * np.pi) * COLUMNS), axis=1)
        noisy = bright + rng.normal(0.0, 2.0, bright.shape)
        yield synthesizer.camera, np.clip(noisy, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return record(tmp_path_factory.mktemp("mcl"), 1)


def record(folder, seconds):
    write_room(folder / "room.ply")
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/tf_static", TFMessage, qos.TF_STATIC)
        for topic, kind in (("/sphere_info", SphereInfo), ("/odom", Odometry), ("/image_raw", Image)):
            bag.add_topic(topic, kind, qos.STATE)
        mount = SE3.from_parts(np.eye(3), np.array([0.2, 0.0, HEIGHT]))
        bag.write("/tf_static", TFMessage(transforms=[se3_to_transform(mount, SECOND, "base_link", "eye")]), SECOND)
        T_odom_map = SE3.from_planar(3.0, 1.0, 2.0)
        for number, ((camera, image), pose) in enumerate(zip(pictures(folder / "room.ply"), POSES, strict=True), 1):
            stamp = number * seconds * SECOND
            T_odom_base = T_odom_map @ base(pose)
            bag.write("/sphere_info", camera_to_sphere_info(camera, "eye"), stamp)
            bag.write("/odom", se3_to_odometry(T_odom_base, 1e-4 * np.eye(6), stamp, ("odom", "base_link")), stamp)
            bag.write("/image_raw", array_to_image(image, stamp, "eye", "mono8"), stamp)
    return folder


def base(pose):
    """The base beneath a camera that is 0.2 m before it."""
    return pose @ SE3.from_planar(-0.2, 0.0, 0.0)


def locate(folder, output, *words) -> int:
    start = ",".join(f"{value:.3f}" for value in (*base(POSES[0]).translation, 0.0, 0.0, 0.0, 1.0))
    words = [f"--initial-pose={start}", *TUNED, *map(str, words)]
    return main(["mcl", str(folder / "room.ply"), str(folder / "bag"), "-o", str(output), *words])


@pytest.mark.slow
def test_a_base_is_found_from_panoramas_in_bare_walls(recorded, tmp_path, capsys):
    assert locate(recorded, tmp_path / "poses.tum", "--json", tmp_path / "s.json", "--bag", tmp_path / "out") == 0
    found = read_tum(tmp_path / "poses.tum")
    assert len(found) >= 3
    for stamp, pose in zip(found.stamps_ns, found.T_map_body, strict=True):
        distance, angle = pose.distance(base(POSES[int(stamp) // SECOND - 1]))
        assert distance < 0.4  # the cells of the cache are 0.35 m wide
        assert angle < np.radians(8)  # headings are compared every 10 degrees
    summary = json.loads((tmp_path / "s.json").read_text())
    assert (summary["images"], summary["poses"]) == (len(POSES), len(found))
    assert f"{len(POSES)} images" in capsys.readouterr().out
    with BagReader(tmp_path / "out") as bag:
        assert bag.topics["/status"].count >= len(POSES)  # silence is told between images, too
        assert bag.topics["/tf"].count >= bag.topics["/pose"].count == len(found)  # told at a pace of its own
