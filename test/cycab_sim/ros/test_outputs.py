from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cycab_sim.params import CameraRigParams, ImuParams, ScanParams, SimCameraParams
from cycab_sim.ros.outputs import Outputs
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.ros.conversions import camera_from_info, image_to_array, message_to_sphere, stamp_ns, transform_to_se3
from sphere_nav.ros.conversions.driving import scan_to_points


class Catcher:
    def __init__(self):
        self.sent, self.kinds = {}, {}

    def add_publisher(self, topic, kind, profile=None):
        self.sent[topic], self.kinds[topic] = [], kind
        return type("Topic", (), {"publish": staticmethod(self.sent[topic].append)})


@pytest.fixture(scope="module")
def simulator(small_params, tmp_path_factory):
    file = tmp_path_factory.mktemp("rig") / "rig.yaml"
    rig = CameraRigParams(kind="ring", size="48,40", file=str(file))
    camera = SimCameraParams(model="panorama", size="96,32")
    return Simulator(replace(small_params, rig=rig, camera=camera))


def published(simulator, *names):
    catcher = Catcher()
    outputs = Outputs(catcher, simulator)
    outputs.publish_statics()
    for name in names:
        outputs.publish(name)
    return catcher


def test_the_rig_publishes_one_instant_that_fits_its_description_and_its_file(simulator):
    sent, file = published(simulator, "rig").sent, Path(simulator.params.rig.file)
    assert file.read_text() == sent["rig_description"][0].data
    rig = read_rig(file)
    places = {t.child_frame_id: transform_to_se3(t.transform) for t in sent["/tf_static"][0].transforms}
    for camera in rig.cameras:
        (image,) = sent[f"cameras/{camera.name}/image_raw"]
        (info,) = sent[f"cameras/{camera.name}/camera_info"]
        assert stamp_ns(image) == stamp_ns(info) == simulator.time_ns
        assert image_to_array(image).shape == (40, 48, 3)
        assert camera_from_info(info) == camera.camera
        T_rig_camera = places["rig_link"].inverse() @ places[image.header.frame_id]
        np.testing.assert_allclose(T_rig_camera.matrix, camera.T_rig_camera.matrix, atol=1e-9)


@pytest.fixture(scope="module")
def ramp(small_params):
    return published(Simulator(replace(small_params, world="ramp")), "camera", "sphere", "odom").sent


def test_image_calibration_sphere_and_frames_belong_together(ramp):
    (image,), (info,), (sphere,) = ramp["image_raw"], ramp["camera_info"], ramp["sphere"]
    assert (
        image_to_array(image).shape[:2] == (camera_from_info(info).height, camera_from_info(info).width) == (120, 160)
    )
    assert (stamp_ns(image), info.header.frame_id) == (stamp_ns(info), image.header.frame_id)
    transforms = [*ramp["/tf_static"][0].transforms, *ramp["/tf"][0].transforms]
    names = {t.child_frame_id: t.header.frame_id for t in transforms}
    assert names == {"camera_optical": "base_link", "sphere_link": "base_link", "base_link": "odom"}
    seen = message_to_sphere(sphere)
    assert seen.image.shape == (64, 128, 3)
    assert np.isinf(seen.range_m).any()  # the sky
    assert not np.isnan(seen.range_m).any()


def test_the_imu_and_the_scanner_are_published_in_their_frames(small_params):
    params = replace(small_params, imu=ImuParams(is_on=True), scan=ScanParams(is_on=True))
    simulator = Simulator(params)
    simulator.step(VehicleCommand(), 10_000_000)
    sent = published(simulator, "imu", "scan").sent
    (imu,), (scan,) = sent["imu"], sent["scan"]
    assert (imu.header.frame_id, scan.header.frame_id) == ("imu_link", "scan_link")
    assert {t.child_frame_id for t in sent["/tf_static"][0].transforms} >= {"imu_link", "scan_link"}
    assert stamp_ns(imu) == stamp_ns(scan) == simulator.time_ns
    assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.2)
    assert imu.linear_acceleration_covariance[0] == pytest.approx(0.03**2)
    assert scan.angle_min + 540 * scan.angle_increment == pytest.approx(scan.angle_max)
    points = scan_to_points(scan)
    assert len(points) > 30  # a street
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), simulator.scan()[np.isfinite(scan.ranges)])


def test_delayed_outputs_come_later_with_their_stamps_and_in_order(small_params):
    simulator = Simulator(small_params)
    catcher = Catcher()
    outputs = Outputs(catcher, simulator)
    simulator.faults.add("camera", "delayed", 0.25, 0.0, 0.0, simulator.time_ns)
    simulator.faults.add("odom", "delayed", 0.1, 0.0, 0.0, simulator.time_ns)
    begun, arrivals, answered = simulator.time_ns, [], []
    for _ in range(70):
        answered.append(outputs.publish_late())
        arrivals += [simulator.time_ns] * (len(catcher.sent["image_raw"]) - len(arrivals))
        for name in simulator.take_due():
            assert name != "camera" or outputs.publish(name) is None  # nothing to wait for yet
            if name == "odom":
                outputs.publish(name)
        simulator.step(VehicleCommand(), 10_000_000)
    stamps = [stamp_ns(message) for message in catcher.sent["image_raw"]]
    assert stamps == [begun + 100_000_000 * k for k in range(5)]
    assert [stamp for stamp in answered if stamp is not None] == stamps
    assert [arrival - stamp for arrival, stamp in zip(arrivals, stamps, strict=True)] == [250_000_000] * 5
    assert stamp_ns(catcher.sent["odom"][-1]) == simulator.time_ns - 120_000_000  # the last step at which one was due
    assert len(catcher.sent["odom"]) == len(catcher.sent["/tf"])
