"""The node sphere_mapper on an offline bus: every kind of input, what it tells, calls, refusals; and over real DDS."""

from types import SimpleNamespace

import numpy as np
import pytest
from sensor_msgs.msg import Imu
from sphere_nav_msgs.srv import SaveMap
from tf2_msgs.msg import TFMessage

from sphere_mapping.ros.node import SphereMapper
from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import (
    header,
    message_to_cloud,
    message_to_graph,
    odometry_to_se3,
    path_to_poses,
    se3_to_odometry,
    se3_to_transform,
    transform_to_se3,
)
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.recordings import CAMERA, FIRST, FRAME, PERIOD_NS, STEP, T_BASE_CAMERA, mount, pose, rgbd, stamp

T_ROOM_MAP = FIRST @ T_BASE_CAMERA.inverse()  # where the vehicle was when the drive began; it stood level


@pytest.fixture(scope="module", autouse=True)
def kernels_are_loaded():
    """Charge what the first node of a process loads to no test."""
    OfflineBus().add(SphereMapper, {})


class Bench:
    """A node on an offline bus; `said` is all that it published, by topic."""

    def __init__(self, **values):
        self.bus = OfflineBus()
        self.node = self.bus.add(SphereMapper, values)
        self.said = {}
        self.settle()

    def send(self, *messages):
        for topic, message in messages:
            self.bus.publish(topic if topic.startswith("/") else "/" + topic, message)
        self.settle()

    def settle(self):
        for item in self.bus.settle():
            self.said.setdefault(item.topic, []).append(item.message)

    def drive(self, source, numbers):
        self.send(("/tf_static", mount()))
        for number in numbers:
            self.bus.now_ns = stamp(number)
            self.send(*source(number))

    def call(self, name, request=None):
        answer = self.node.endpoints.call(name, request)
        self.settle()
        return answer


def test_graph_cloud_markers_and_path_are_told():
    bench = Bench(input="rgbd", **{"mapper.key.max_parallax": 0.02})
    bench.drive(rgbd, range(5))
    graph = message_to_graph(bench.said["/graph"][-1])
    assert len(graph) == len(bench.node.mapper.graph) > 1
    assert len(graph.edges) == len(graph) - 1
    assert [message.version for message in bench.said["/graph"]] == list(range(1, len(bench.said["/graph"]) + 1))
    assert len(bench.said["/graph/markers"][-1].markers[0].points) == len(graph)
    cloud = message_to_cloud(bench.said["/map_cloud"][-1])
    in_room = T_ROOM_MAP.apply(cloud)
    outside = np.max(np.abs(in_room) / (4.0, 3.0, 2.0), axis=1)
    assert np.percentile(np.abs(outside - 1), 95) < 0.02  # all points lie on the walls
    assert len(path_to_poses(bench.said["/path"][-1])) == 5


def test_odometry_is_used_that_comes_before_its_sphere_and_there_is_one_parent_only():
    bench = Bench(input="rgbd")
    used, add = [], bench.node.mapper.add
    bench.node.mapper.add = lambda sphere, odometry, unroll: used.append(odometry) or add(sphere, odometry, unroll)
    bench.send(("/tf_static", mount()))
    speed = np.concatenate([STEP.log()[:3], STEP.log()[3:]]) / (PERIOD_NS * 1e-9)
    late = 30_000_000  # the newest odometry is older than the sphere, as when both arrive in time
    for number in range(6):
        if number != 3:  # one message is lost
            T = FIRST.inverse() @ pose(number - late / PERIOD_NS)
            T_odom_base, twist = T @ T_BASE_CAMERA.inverse(), T_BASE_CAMERA.adjoint() @ speed
            message = se3_to_odometry(T_odom_base, np.zeros((6, 6)), stamp(number) - late, ("odom", "base_link"), twist)
            bench.send(("odom", message))
        bench.send(*rgbd(number))
    assert all(T is not None for T in used)
    for number, T_odom_sphere in enumerate(used):
        assert T_odom_sphere.distance(FIRST.inverse() @ pose(number))[0] < 1e-3
    parents = {(t.header.frame_id, t.child_frame_id) for said in bench.said["/tf"] for t in said.transforms}
    assert parents == {("map", "odom")}


def test_a_saved_map_is_read_back_as_it_was(tmp_path):
    bench = Bench(input="rgbd", map_folder=str(tmp_path))
    assert "empty" in bench.call("save_map", SaveMap.Request(path="early")).message
    bench.drive(rgbd, range(3))
    answer = bench.call("save_map", SaveMap.Request(path="room"))
    assert answer.success, answer.message
    assert answer.num_spheres == len(bench.node.mapper.graph)
    with open_map(tmp_path / "room") as reader:
        kept = bench.node.mapper.graph[0].sphere
        loaded = reader.load_sphere(0)
        np.testing.assert_array_equal(loaded.image, kept.image)
        np.testing.assert_allclose(loaded.range_m, kept.range_m, rtol=1.1e-4)
        assert reader.parameters["key.max_mad_share"] == 0.05
    assert not bench.call("save_map", SaveMap.Request(path="room")).success
    assert bench.call("save_map", SaveMap.Request(path="room", overwrite=True)).success


def test_a_nan_depth_gives_no_pose_that_is_nan():
    bench = Bench(input="rgbd")
    bench.drive(rgbd, range(1))
    blind = [(topic, message) for topic, message in rgbd(1)]
    blind[1][1].data = np.full(CAMERA.width * CAMERA.height, np.nan, np.float32).tobytes()
    bench.send(*blind)
    for message in bench.said["/odometry"]:
        assert np.isfinite(odometry_to_se3(message)[0].matrix).all()
        assert np.isfinite(message.pose.covariance).all()


def test_without_mounts_the_camera_is_the_vehicle():
    bench = Bench(input="rgbd")
    bench.send(*rgbd(0))
    np.testing.assert_allclose(odometry_to_se3(bench.said["/odometry"][0])[0].translation, 0.0, atol=1e-9)
    bench.send(*rgbd(3))
    told = odometry_to_se3(bench.said["/odometry"][-1])[0]
    distance, angle = told.distance(pose(0).inverse() @ pose(3))  # x ahead, as of a vehicle
    assert distance < 0.005
    assert angle < 0.005


MOUNTINGS = {
    "aside": "0.4,0.1,1.1,0,0,0.2",
    "rolled": f"0.4,0,1.1,{np.pi / 2},0,0",
    "inverted": f"0.4,0,1.1,{np.pi},0,0",
}


@pytest.mark.parametrize("mounting", MOUNTINGS.values(), ids=MOUNTINGS)
def test_however_the_camera_is_mounted_the_vehicle_drives_the_same_path(mounting):
    bench = Bench(input="rgbd", mounting=mounting)
    T_base_camera = read_mounting(mounting)

    def source(number):
        return rgbd(number, T_ROOM_MAP @ path(number) @ T_base_camera)

    def path(number):
        return SE3.exp(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.02]) * number)

    bench.drive(source, [0, 2, 4])  # /tf_static says otherwise
    told = [odometry_to_se3(message)[0] for message in bench.said["/odometry"]]
    assert told[0].distance(SE3.identity()) == pytest.approx((0.0, 0.0), abs=1e-9)
    errors = np.array([at.distance(path(number)) for at, number in zip(told, [0, 2, 4], strict=True)])
    assert np.all(errors.max(axis=0) < (0.004, np.radians(0.1)))
    (moved,) = bench.said["/tf"][-1].transforms
    assert (moved.header.frame_id, moved.child_frame_id) == ("map", "base_link")
    assert transform_to_se3(moved.transform).distance(told[-1])[0] < 1e-6
    up = bench.node.mapper.graph[0].T_map_sphere.rotation[2, 2]  # its spheres are upright, whatever the camera is
    assert up == pytest.approx(1.0, abs=1e-9)


def test_a_vehicle_whose_camera_is_far_ahead_is_unsure_aside_where_that_is_unsure_of_its_heading():
    bench = Bench(input="rgbd", mounting="2,0,1,0,0,0")
    bench.drive(rgbd, [0])
    found = SimpleNamespace(covariance=np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 0.01]), mad=0.0)
    update = SimpleNamespace(stamp_ns=stamp(1), alignment=found, is_key=False)
    bench.node.publish_pose(update, bench.node.mapper.graph[0].T_map_sphere)
    bench.settle()
    np.testing.assert_allclose(bench.said["/odometry"][-1].pose.covariance[7:12:4], [0.04, -0.02], atol=1e-9)


def imu(number, R_base_imu, R_level_base):
    message = Imu(header=header(stamp(0) + number * 5_000_000, "imu_link"))
    force = R_base_imu.T @ R_level_base.T @ [0.0, 0.0, 9.81]
    message.linear_acceleration.x, message.linear_acceleration.y, message.linear_acceleration.z = map(float, force)
    message.orientation_covariance[0] = -1.0
    return message


@pytest.mark.parametrize(("roll", "is_in_camera"), [(0.0, False), (np.pi, False), (0.0, True)])
def test_gravity_levels_the_map_unless_the_imu_is_of_another_frame(roll, is_in_camera):
    """One in a camera whose place a parameter gives is where /tf says that it is in the camera."""
    T_base_imu = SE3.from_angles(np.pi / 2, 0.2, 0.3, [0.0, 0.0, 0.4])
    R_level_base = SE3.from_angles(roll + 0.02, 0.1, 0.0, np.zeros(3)).rotation
    bench = Bench(input="rgbd", mounting="0.4,0,1.1,0,0,0" * is_in_camera)
    place = se3_to_transform(T_base_imu, stamp(0), "base_link", "imu_link")
    if is_in_camera:
        T_base_lens = T_BASE_CAMERA @ T_BODY_OPTICAL
        place = se3_to_transform(T_base_lens.inverse() @ T_base_imu, stamp(0), FRAME, "imu_link")
    bench.send(("/tf_static", TFMessage(transforms=[*mount().transforms[3 * is_in_camera :], place])))
    bench.send(*(("imu", imu(number, T_base_imu.rotation, R_level_base)) for number in range(-30, 0)))
    bench.send(*rgbd(0))
    T_map_base, _ = odometry_to_se3(bench.said["/odometry"][0])
    expected = R_level_base if roll == 0.0 else np.eye(3)
    np.testing.assert_allclose(T_map_base.rotation, expected, atol=1e-6)
    source = "gravity (IMU at rest)" if roll == 0.0 else "the mounting"
    assert bench.node.mapper.origin == f"base_link at the first sphere, level by {source}"
    np.testing.assert_allclose(bench.node.mapper.T_base_sphere.matrix, bench.node.T_base_sphere.matrix)
