"""`sphere_nav localize` with several cameras, and with whole spheres that nobody calibrated."""

import pytest
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.main import main
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, drive, make_map
from worlds.room import wide_room

pytestmark = pytest.mark.slow

START_NS, NUM = 1_000_000_000, 5
CAMERAS = {"front": SE3.from_planar(0.3, 0.0, 0.1), "back": SE3.from_planar(-0.3, 0.1, 3.0)}
BASE = [pose @ T_BODY_OPTICAL.inverse() for pose in drive(NUM)]
SPHERE = Spherical(256, 128)
TUNED = [word for name, value in SMALL_IMAGES.items() for word in ("--set", f"{name}={value}")]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A map of the room, and a bag with two cameras and a panorama; the calibration of a third camera is missing."""
    folder, room = tmp_path_factory.mktemp("cameras"), wide_room()
    save_map(folder / "map", make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0)]).graph)
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/tf_static", TFMessage, qos.TF_STATIC)
        mounts = [se3_to_transform(T @ T_BODY_OPTICAL, START_NS, "base_link", name) for name, T in CAMERAS.items()]
        bag.write("/tf_static", TFMessage(transforms=mounts), START_NS)
        for name in (*CAMERAS, "around", "raw"):
            bag.add_topic(f"/{name}/image_raw", Image, qos.STATE)
        for name in CAMERAS:
            bag.add_topic(f"/{name}/camera_info", CameraInfo, qos.STATE)
        for k, T_room_base in enumerate(BASE):
            stamp = START_NS + k * STEP_NS
            for name, T in CAMERAS.items():
                image = room.photograph(PINHOLE, T_room_base @ T @ T_BODY_OPTICAL, k)
                bag.write(f"/{name}/camera_info", camera_to_info(PINHOLE, stamp, name), stamp)
                bag.write(f"/{name}/image_raw", array_to_image(image, stamp, name, "mono8"), stamp)
            image = room.photograph(SPHERE, T_room_base, 90 + k)
            bag.write("/around/image_raw", array_to_image(image, stamp, "around", "mono8"), stamp)
            bag.write("/raw/image_raw", array_to_image(image[:100], stamp, "raw", "mono8"), stamp)
    return folder


def localize(recorded, output, *words) -> int:
    return main(["localize", str(recorded / "map"), str(recorded / "bag"), "-o", str(output), *TUNED, *map(str, words)])


@pytest.mark.parametrize(
    "words",
    [
        ("--camera", "front=/front/image_raw", "--camera", "back=/back/image_raw"),
        ("--set", "is_panorama=true", "--image", "/around/image_raw"),
    ],
    ids=["two cameras", "panorama"],
)
def test_the_poses_are_those_of_the_base(recorded, tmp_path, words):
    assert localize(recorded, tmp_path / "poses.tum", *words) == 0
    found = read_tum(tmp_path / "poses.tum")
    assert list(found.stamps_ns) == [START_NS + k * STEP_NS for k in (3, 4)]
    for k, truth in enumerate(BASE[3:]):
        meters, radians = found.T_map_body[k].distance(truth)
        assert (meters < 0.015, radians < 0.008) == (True, True)


def test_images_without_calibration_are_refused_by_name(recorded, tmp_path, capsys):
    words = ("--camera", "front=/front/image_raw", "--camera", "raw=/raw/image_raw")
    assert localize(recorded, tmp_path / "poses.tum", *words) == 2
    error = capsys.readouterr().err
    assert "camera_info of /raw/image_raw" in error
    assert "--remap cameras/raw/camera_info:=TOPIC" in error
    assert "Traceback" not in error
