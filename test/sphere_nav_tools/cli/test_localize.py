"""`sphere_nav localize`: a bag against a map, by one camera or several; what is written, counted and refused."""

import json
from argparse import ArgumentParser, ArgumentTypeError
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CompressedImage
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.localization.status import Reason, State, Status
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav.ros.bags.streams import Stream
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    se3_to_pose_with_covariance,
    se3_to_transform,
    status_to_message,
)
from sphere_nav.ros.conversions.headers import header
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.localizing import RecordedCamera, patience, write_poses
from sphere_nav_tools.offline.settings import read_pose
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, drive, picture, wide_map

START_NS = 1_000_000_000
NUM_IMAGES = 8
TUNED = [word for name, value in SMALL_IMAGES.items() for word in ("--set", f"{name}={value}")]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("localize")
    save_map(folder / "map", wide_map(-2.0, -1.0, 0.0).graph)
    with BagWriter(folder / "bag") as bag:
        transform = se3_to_transform(T_BODY_OPTICAL, START_NS, "base_link", "optical")
        bag.write("/tf_static", TFMessage(transforms=[transform]), START_NS)
        for k in range(NUM_IMAGES):
            stamp = START_NS + k * STEP_NS
            bag.write("/camera_info", camera_to_info(PINHOLE, stamp, "optical"), stamp)
            bag.write("/image_raw", array_to_image(picture(k), stamp, "optical", "mono8"), stamp)
    return folder


def localize(recorded, output, *words) -> int:
    return main(["localize", str(recorded / "map"), str(recorded / "bag"), "-o", str(output), *TUNED, *map(str, words)])


def test_trusted_poses_of_the_base_are_written_with_a_summary(recorded, tmp_path, capsys):
    assert localize(recorded, tmp_path / "poses.tum", "--json", tmp_path / "s.json", "--bag", tmp_path / "out") == 0
    found = read_tum(tmp_path / "poses.tum")
    assert list(found.stamps_ns) == [START_NS + k * STEP_NS for k in range(1, NUM_IMAGES)]  # two images of probation
    assert found.covariances is not None
    for k, pose in enumerate(drive(NUM_IMAGES)[1:]):
        assert found.T_map_body[k].distance(pose @ T_BODY_OPTICAL.inverse())[0] < 0.015  # as in tracking
    summary = json.loads((tmp_path / "s.json").read_text())
    assert (summary["images"], summary["poses"]) == (NUM_IMAGES, NUM_IMAGES - 1)
    assert summary["states"] == {"PROBATION": 1, "TRACKING": NUM_IMAGES - 1}
    assert summary["milliseconds"]["p99"] >= summary["milliseconds"]["median"] > 0
    assert "8 images, 7 poses" in capsys.readouterr().out
    with BagReader(tmp_path / "out") as bag:
        counts = {topic: found.count for topic, found in bag.topics.items()}
        assert counts == {"/pose": 7, "/odometry": 7, "/status": NUM_IMAGES, "/tf": 7}
        first = next(bag.messages(["/pose"])).message
        assert isinstance(first, PoseWithCovarianceStamped)


def status(state, reason="", milliseconds=0.0):
    return Recorded("/status", 0, status_to_message(Status(state, str(reason), milliseconds=milliseconds), 5, "map"))


def pose(second, x):
    return Recorded(
        "/pose", 0, se3_to_pose_with_covariance(SE3.from_planar(x, 2.0, 0.5), 1e-4 * np.eye(6), second * 10**9, "map")
    )


def arguments(folder, **values):
    return SimpleNamespace(**({"output": folder / "out.tum", "json": None, "overwrite": False} | values))


NEWS = [
    status(State.SEARCHING, Reason.AMBIGUOUS, 8.0), status(State.TRACKING, "", 10.0), pose(1, 1.0),
    status(State.LOST, Reason.TIMEOUT, 99.0), status(State.TRACKING, "", 12.0), pose(2, 1.5), status(State.TRACKING),
]  # fmt: skip


def test_poses_and_figures_are_written(tmp_path, capsys):
    assert write_poses(arguments(tmp_path, json=tmp_path / "out.json"), iter(NEWS)) == 0
    found = read_tum(tmp_path / "out.tum")
    np.testing.assert_array_equal(found.stamps_ns, [10**9, 2 * 10**9])
    np.testing.assert_allclose(found.positions, [[1.0, 2.0, 0.0], [1.5, 2.0, 0.0]], atol=1e-6)
    assert json.loads((tmp_path / "out.json").read_text()) == {
        "images": 4,  # what is said between two images is no answer to one
        "poses": 2,
        "states": {"SEARCHING": 1, "TRACKING": 3},
        "reasons": {"AMBIGUOUS": 1},
        "milliseconds": {"median": 10.0, "p99": pytest.approx(np.percentile([8.0, 10.0, 12.0], 99))},
    }
    told = capsys.readouterr().out.splitlines()
    assert told[0] == f"4 images, 2 poses -> {tmp_path / 'out.tum'}"
    assert [line.split() for line in told[1:4]] == [
        ["3", "TRACKING"], ["1", "SEARCHING", "AMBIGUOUS"], ["1", "LOST", "TIMEOUT"],
    ]  # fmt: skip
    assert told[4] == "time for an image: median 10.0 ms, p99 12.0 ms"


def test_no_pose_is_a_failure(tmp_path):
    """No file of none stands in the way of the next try."""
    assert write_poses(arguments(tmp_path), iter(NEWS[:1])) == 1
    assert not (tmp_path / "out.tum").exists()


def test_an_initial_pose_is_read_with_its_signs():
    T = SE3.exp([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    found = read_pose(",".join(map(str, [*T.translation, *T.quaternion])))
    np.testing.assert_allclose(found.matrix, T.matrix, atol=1e-9)
    for text in ("1,2,3,0,0,0,0", "1,2,3"):
        with pytest.raises(ArgumentTypeError, match="expected x,y,z,qx,qy,qz,qw"):
            read_pose(text)


def test_a_clock_that_is_set_back_costs_no_pose(tmp_path, caplog):
    hour = 3600
    news = [pose(hour + 1, 1.0), pose(hour + 2, 2.0), pose(1, 3.0), pose(2, 4.0), pose(2, 5.0)]
    assert write_poses(arguments(tmp_path), iter(news)) == 0
    found = read_tum(tmp_path / "out.tum")
    assert (found.stamps_ns // 10**9).tolist() == [1, 2, hour + 1, hour + 2]
    np.testing.assert_allclose(found.positions[:, 0], [3.0, 5.0, 1.0, 2.0])
    assert "stamps go back 2 times" in caplog.text


IMAGE = "sensor_msgs/msg/Image"


def test_a_slow_camera_is_waited_for_as_long_as_four_images_take(caplog):
    for rate_hz, timeout_s in [(1.0, 4.0), (2.0, 2.0), (30.0, None), (8.0, None), (0.0, None)]:
        streams = [Stream("/image", IMAGE, 20, rate_hz), Stream("/other", IMAGE, 20, 0.1)]
        assert patience(streams, ["/image"]) == ({"input.timeout_s": timeout_s} if timeout_s else {})
        assert ("input.timeout_s" in caplog.text) == bool(timeout_s)
        caplog.clear()


def no_options():
    parser = ArgumentParser()
    topics.add_options(parser)
    return parser.parse_args([])


def test_compressed_images_come_with_stamp_and_calibration(tmp_path, rng):
    image = rng.integers(0, 255, (PINHOLE.height, PINHOLE.width), np.uint8)
    data = cv2.imencode(".png", image)[1].tobytes()
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/front/camera_info", camera_to_info(PINHOLE, 5, "front_optical"), 5)
        message = CompressedImage(header=header(7, "front_optical"), format="png", data=data)
        bag.write("/front/image_raw/compressed", message, 7)
    recorded = RecordedCamera(tmp_path / "bag", no_options())
    assert recorded.frame_id == "front_optical"
    assert recorded.camera == PINHOLE
    ((stamp, found),) = recorded.images()
    assert stamp == 7
    assert np.array_equal(found, image)
