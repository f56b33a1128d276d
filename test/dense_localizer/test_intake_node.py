import numpy as np
import pytest

pytest.importorskip("rclpy")

from tf2_msgs.msg import TFMessage

from dense_localizer.intake_node import Intake
from dense_localizer.params import DenseLocalizerParams
from node_kit.conversions import array_to_image, camera_to_info, se3_to_odometry, se3_to_transform
from node_kit.node import ManagedNode
from node_kit.replay import OfflineBus
from sphere_geometry import SE3
from sphere_map.sphere import T_BODY_OPTICAL
from typed_params import build
from worlds.localizer import PINHOLE

SECOND = 1_000_000_000
PICTURE = np.zeros((120, 160), np.uint8)


class Gate:
    """An intake on a bus, and what it hands on."""

    def __init__(self, **values):
        self.bus, self.got = OfflineBus(), []
        node = self.bus.add(ManagedNode)
        params = build(DenseLocalizerParams, values)
        self.intake = Intake(node, params, lambda image, fault: self.got.append((image, fault.reason)))

    def send(self, topic, message):
        self.bus.publish(topic, message)
        list(self.bus.settle())

    def image(self, stamp=SECOND, frame="optical"):
        self.send("/image_raw", array_to_image(PICTURE, stamp, frame, "mono8"))

    def info(self, frame="optical"):
        self.send("/camera_info", camera_to_info(PINHOLE, SECOND, frame))


def test_an_image_is_handed_on_when_all_is_known():
    gate = Gate()
    gate.image()
    gate.info()
    assert gate.got == []
    transform = se3_to_transform(T_BODY_OPTICAL, SECOND, "base_link", "optical")
    gate.send("/tf_static", TFMessage(transforms=[transform]))
    gate.image(2 * SECOND)
    assert [reason for _, reason in gate.got] == ["", ""]
    np.testing.assert_allclose(gate.intake.T_base_camera.matrix, T_BODY_OPTICAL.matrix, atol=1e-12)


@pytest.mark.parametrize("values", [{"base_frame": "optical"}, {"base_frame": ""}])
def test_no_transform_is_needed_where_the_camera_is_the_base(values):
    gate = Gate(**values)
    gate.info()
    gate.image()
    assert [reason for _, reason in gate.got] == [""]
    np.testing.assert_array_equal(gate.intake.T_base_camera.matrix, np.eye(4))


def test_a_refused_calibration_answers_at_once():
    gate = Gate()
    info = camera_to_info(PINHOLE, SECOND, "optical")
    info.k = [0.0] * 9
    gate.send("/camera_info", info)
    gate.image()
    assert [reason for _, reason in gate.got] == ["BAD_INFO"]
    gate.intake.forget_camera()
    gate.image(2 * SECOND)
    assert len(gate.got) == 1  # calibration may still come


def test_odometry_is_that_of_the_camera():
    gate = Gate(base_frame="")
    assert gate.intake.T_odom_camera(SECOND) is None
    T_odom_base = SE3.from_planar(1.0, 2.0, 0.3)
    gate.send("/odom", se3_to_odometry(T_odom_base, np.eye(6), SECOND, ("odom", "base_link")))
    np.testing.assert_allclose(gate.intake.T_odom_camera(SECOND).matrix, T_odom_base.matrix, atol=1e-12)
    assert gate.intake.odom_frame == "odom"
