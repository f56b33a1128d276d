"""The node mcl_depth on an offline bus: clouds from everywhere, an early initial pose, what viewers see, help."""

import numpy as np
import pytest

from sphere_nav.ros.conversions import cloud_to_message, pose_to_se3, pose_with_covariance_to_se3
from worlds.mcl import COLUMNS, SECOND, T_BASE_EYE, Bench, Eye, drive, room_points

NEAR_M, NEAR_RAD = 0.4, np.radians(8.0)  # cells of the cache are 0.35 m wide, headings are compared every 10 degrees


@pytest.fixture(scope="module")
def eye():
    return Eye()


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "room.npy"
    np.save(path, room_points())
    return path


def error(answer, truth):
    T_map_base, _ = pose_with_covariance_to_se3(answer["/pose"], "map")
    return T_map_base.distance(truth)


@pytest.mark.slow
def test_a_base_is_found_in_a_cloud_and_viewers_get_places_compass_particles_and_depth(eye, cloud):
    bench = Bench(eye, cloud)
    poses = drive()
    answer = bench.follow_from(poses)[-1]
    assert answer["/status"].state == "TRACKING"
    meters, radians = error(answer, poses[-1])
    assert meters < NEAR_M
    assert radians < NEAR_RAD
    markers = answer["/hypotheses"].markers
    assert markers[0].action == markers[0].DELETEALL
    assert markers[1].ns == "places"
    assert np.hypot(*(np.array([markers[1].pose.position.x, markers[1].pose.position.y])
                      - (poses[-1] @ T_BASE_EYE).translation[:2])) < NEAR_M  # fmt: skip
    compass, pose = map(pose_to_se3, (answer["/heading"].pose, answer["/pose"].pose.pose))
    assert abs((compass.inverse() @ pose).yaw) < np.radians(15.0)  # compass and pose agree to a step and a half
    depth = answer["/synthesized_depth"]
    assert (depth.encoding, depth.width) == ("32FC1", COLUMNS)
    assert len(bench.node.filter.map.cache) > 10  # depth images


@pytest.mark.slow
def test_a_cloud_may_come_by_topic(eye):
    bench = Bench(eye)
    poses = drive()
    assert bench.see(poses[0])["/status"].state == "NO_MAP"
    points = np.concatenate([room_points(), [[np.nan, 0.0, 0.0]]])
    bench.send("/cloud", cloud_to_message(points, SECOND, "map"))
    answers = bench.follow_from(poses)
    assert answers[-1]["/status"].state == "TRACKING"
    assert error(answers[-1], poses[-1])[0] < NEAR_M
    before = bench.node.clouds.geometry
    told = next(item for item in bench.node.inputs if item.topic == "cloud")
    bench.send("/cloud", cloud_to_message(points, SECOND, "odom"))
    assert "header.frame_id: expected 'map', found 'odom'" in told.last_refusal
    bench.send("/cloud", cloud_to_message(np.empty((0, 3)), SECOND, "map"))
    assert "expected at least one finite point" in told.last_refusal
    assert bench.node.clouds.geometry is before
