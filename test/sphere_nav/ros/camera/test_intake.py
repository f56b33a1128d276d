"""What is put together before an image is localised, and what is said of images that cannot be used."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.localization.params import NodeParams, RigParams
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.intake import Cameras, rig_names
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    camera_to_sphere_info,
    header,
    se3_to_odometry,
    se3_to_transform,
)
from sphere_nav.ros.node import ManagedNode
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

SLACK_S = 0.01  # of depth; written out: imported, a change would go unseen

SECOND = 10**9
CAMERA = Pinhole(16, 8, 10.0, 10.0, 7.5, 3.5)
PIXELS = np.arange(128, dtype=np.uint8).reshape(8, 16)
DEPTH_CAMERA = Pinhole(12, 6, 9.0, 8.0, 5.5, 2.5)
T_IMAGE_DEPTH = SE3.exp([0.05, 0.0, 0.01, 0.0, 0.02, 0.0])
MOUNT = SE3.exp([0.5, 0.0, 1.4, -0.3, 0.1, 0.3])


class Gate:
    def __init__(self, *, rig=None, has_depth=False, **values):
        self.bus, self.pictures, self.refusals = OfflineBus(), [], []
        self.node = self.bus.add(ManagedNode)
        callbacks = self.pictures.append, lambda stamp, finding: self.refusals.append((stamp // SECOND, finding))
        params = NodeParams(**values)
        self.intake = Cameras(self.node.endpoints, params, *callbacks, rig=rig, has_depth=has_depth)

    def image(self, second, frame="optical", encoding="mono8"):
        self.send("image_raw", array_to_image(PIXELS, second * SECOND, frame, encoding))

    def depth(self, second, meters=2.0, shape=(8, 16), frame="optical"):
        pixels = np.full(shape, meters, np.float32)
        self.send("depth/image_raw", array_to_image(pixels, round(second * SECOND), frame, "32FC1"))

    def seen(self):
        return [(p.stamp_ns // SECOND, p.depth and float(p.depth.depth_m[0, 0])) for p in self.pictures]

    def refusal(self, topic="depth/image_raw"):
        return next(item for item in self.node.inputs if item.topic == topic).last_refusal

    def info(self, frame="optical", focal=10.0):
        message = camera_to_info(CAMERA, SECOND, frame)
        message.k = [focal, 0.0, 7.5, 0.0, focal, 3.5, 0.0, 0.0, float(focal > 0)]
        self.send("camera_info", message)

    def mount(self, frame="optical"):
        self.send("tf_static", TFMessage(transforms=[se3_to_transform(MOUNT, SECOND, "base_link", frame)]))

    def send(self, topic, message):
        self.bus.deliver(f"/{topic}", message)

    def stamps(self):
        return [picture.stamp_ns // SECOND for picture in self.pictures]

    def reasons(self):
        return [(second, str(finding.reason)) for second, finding in self.refusals]


def ready(**values):
    gate = Gate(**values)
    gate.info()
    gate.mount()
    return gate


def test_images_are_answered_by_what_lacks_until_calibration_and_transform_have_come():
    gate = Gate()
    gate.image(1)
    gate.info()
    gate.image(2)
    assert gate.reasons() == [(1, "BAD_INFO"), (2, "TF_STALE")]
    assert "no camera_info yet" in gate.refusals[0][1].detail
    gate.mount()
    gate.image(3)
    assert gate.stamps() == [3]
    np.testing.assert_allclose(gate.pictures[0].T_base_camera.matrix, MOUNT.matrix, atol=1e-12)
    np.testing.assert_array_equal(gate.pictures[0].image, PIXELS)
    assert gate.pictures[0].camera == CAMERA


def test_a_dark_image_of_sixteen_bits_is_not_stretched():
    gate = ready()
    bright = PIXELS.astype(np.uint16) * 32  # up to 4064: 12 bits
    for second, levels in enumerate((bright, bright // 8), 1):
        gate.send("image_raw", array_to_image(levels, second * SECOND, "optical", "mono16"))
    np.testing.assert_array_equal(gate.pictures[-1].image, bright // 8 >> 4)


def test_no_transform_is_needed_where_the_camera_is_the_base_or_its_mounting_is_given():
    base, mounted = SE3.identity(), SE3.from_parts(T_BODY_OPTICAL.rotation, [1.0, 2.0, 3.0])  # which looks ahead
    places = [({"base_frame": "optical"}, base), ({"base_frame": ""}, base), ({"mounting": "1,2,3,0,0,0"}, mounted)]
    for values, expected in places:
        gate = Gate(**values)
        gate.info()
        gate.image(1)
        np.testing.assert_allclose(gate.pictures[0].T_base_camera.matrix, expected.matrix, atol=1e-12)


def test_a_panorama_that_is_mounted_on_the_base_looks_ahead():
    gate = Gate(mounting="1,2,3,0,0,0", is_panorama=True)
    gate.image(1)
    np.testing.assert_allclose(gate.pictures[0].T_base_camera.matrix, SE3.from_parts(np.eye(3), [1, 2, 3]).matrix)


def test_a_refused_calibration_is_the_answer_until_it_is_forgotten():
    gate = Gate()
    gate.info(focal=0.0)
    gate.image(1)
    assert gate.reasons() == [(1, "BAD_INFO")]
    assert "focal length 0" in gate.refusals[0][1].detail
    gate.intake.forget_camera()
    gate.image(2)
    assert "no camera_info yet" in gate.refusals[1][1].detail


def test_panoramas_are_calibrated_by_sphere_info_or_told_to_be_whole():
    gate = Gate()
    gate.mount()
    gate.send("sphere_info", camera_to_sphere_info(Spherical(16, 8), "optical"))
    gate.image(1)
    assert gate.pictures[0].camera == Spherical(16, 8)
    gate = Gate(is_panorama=True)
    gate.mount()
    gate.image(1)  # 16 x 8
    gate.image(2)
    assert [picture.camera for picture in gate.pictures] == [Spherical(16, 8)] * 2
    assert gate.stamps() == [1, 2]
    assert gate.refusals == []


def test_an_unknown_encoding_is_named_and_not_blamed_on_the_calibration():
    gate = ready()
    gate.send("image_raw", Image(header=header(SECOND, "optical"), encoding="nonsense", width=4, height=4, step=4))
    ((_, finding),) = gate.refusals
    assert finding.reason == "BAD_INFO"
    assert "nonsense" in finding.detail
    assert finding.advice.startswith("publish a usual encoding")
    assert "nonsense" in gate.refusal("image_raw")


def test_of_a_rig_whose_images_nobody_can_read_it_is_told_why():
    gate = Gate(rig=RigParams(cameras="left,right"))
    for name in ("left", "right"):
        gate.mount(name)
        gate.send(f"cameras/{name}/camera_info", camera_to_info(CAMERA, SECOND, name))
        gate.send(f"cameras/{name}/image_raw", Image(header=header(SECOND, name), encoding="nonsense"))
    assert gate.reasons() == [(1, "BAD_INFO")] * 2


def test_a_compressed_image_is_unpacked_only_if_its_size_is_the_cameras():
    gate = ready(transport="compressed")
    for pixels in (PIXELS, np.zeros((9, 16), np.uint8)):
        data = cv2.imencode(".png", pixels)[1].tobytes()
        image = CompressedImage(header=header(SECOND, "optical"), format="png", data=data)
        gate.send("image_raw/compressed", image)
    np.testing.assert_array_equal(gate.pictures[0].image, PIXELS)
    assert gate.reasons() == [(1, "BAD_INFO")]
    assert "expected 16 x 8 (camera_info), found 16 x 9" in gate.refusals[0][1].detail


@pytest.mark.parametrize("topic", ["image", "info"])
def test_another_camera_in_the_same_topics_is_noticed_and_a_reset_accepts_it(topic):
    gate = ready()
    gate.image(1)
    if topic == "image":
        gate.image(2, "other")
    else:
        gate.info("other")
        gate.image(2)
    assert gate.stamps() == [1]
    assert gate.reasons() == [(2, "BAD_INFO")]
    assert "expected 'optical' as before, found 'other'" in gate.refusals[0][1].detail
    gate.intake.forget_camera()
    gate.mount("other")
    gate.info("other")
    gate.image(3, "other")
    assert gate.stamps() == [1, 3]


def test_a_calibration_of_another_frame_than_the_image_is_refused_unless_the_frame_is_given():
    gate = Gate()
    gate.mount("other")
    gate.mount()
    gate.info("other")
    gate.image(1)
    assert "expected that of camera_info, 'other', found 'optical'" in gate.refusals[0][1].detail
    given = Gate(camera_frame="optical")
    given.mount()
    given.info("other")
    given.image(1)
    assert given.stamps() == [1]


def test_a_stamp_ahead_of_the_clock_is_refused_and_a_little_is_allowed():
    gate = ready()
    list(gate.bus.advance(10 * SECOND))
    gate.image(11)
    assert gate.reasons() == [(11, "BAD_STAMP")]
    refusal = gate.refusals[0][1]
    assert (refusal.detail, refusal.value, refusal.limit) == ("stamp is 1.000 s ahead of the clock", 1.0, 0.1)
    gate.send("image_raw", array_to_image(PIXELS, 10 * SECOND + SECOND // 20, "optical", "mono8"))
    assert len(gate.pictures) == 1


def test_an_image_comes_with_odometry_at_its_stamp():
    gate = ready()
    T_odom_base = SE3.from_planar(1.0, 2.0, 0.3)
    gate.send("odom", se3_to_odometry(T_odom_base, np.eye(6), SECOND, ("odom", "base_link")))
    gate.image(1)
    np.testing.assert_allclose(gate.pictures[0].T_odom_base.matrix, T_odom_base.matrix, atol=1e-12)
    gate.image(5)
    assert gate.pictures[1].T_odom_base is None


def test_names_are_those_of_the_calibration_unless_some_are_chosen():
    rig = Rig(tuple(RigCamera(name, CAMERA, SE3.identity()) for name in ("a", "b", "c")))
    assert rig_names(RigParams(), rig) == ("a", "b", "c")
    assert rig_names(RigParams(cameras="c, a"), rig) == ("c", "a")
    assert rig_names(RigParams(cameras="left,right"), None) == ("left", "right")
    for words in ("d", "a,a"):
        with pytest.raises(ValueError, match="expected different names"):
            rig_names(RigParams(cameras=words), rig)
    with pytest.raises(ValueError, match="found none"):
        rig_names(RigParams(), None)


# --- depth beside images: each goes on once, in order, with the depth of its instant or without
def deep():
    gate = Gate(has_depth=True, mounting="0,0,1,0,0,0")
    gate.info()
    return gate


@pytest.mark.parametrize("order", [("image", "depth"), ("depth", "image")])
def test_an_image_goes_on_with_the_depth_of_its_instant(order):
    gate = deep()
    for second in (1, 2):
        for kind in order:
            gate.depth(second + 0.4 * SLACK_S, 2.0 + second) if kind == "depth" else gate.image(second)
    assert gate.seen() == [(1, 3.0), (2, 4.0)]
    assert gate.pictures[0].depth.camera == CAMERA
    np.testing.assert_array_equal(gate.pictures[0].depth.T_image_depth.matrix, np.eye(4))


def test_depth_a_hundredth_of_a_second_and_a_half_later_is_of_no_image():
    gate = deep()
    for second in (1, 2):
        gate.image(second)
        gate.depth(second + 1.5 * SLACK_S * (second == 1), 2.0 + second)
    assert gate.seen() == [(1, None), (2, 4.0)]


def test_an_image_without_depth_waits_for_the_next_one_and_after_some_for_none():
    gate = deep()
    gate.image(1)
    assert gate.seen() == []
    gate.depth(1.5)  # of no image
    for second in (2, 3, 4):
        gate.image(second)
    assert gate.seen()[:2] == [(1, None), (2, None)]
    for second in (5, 6):
        gate.image(second)
    assert gate.seen()[-1] == (6, None)  # no depth for long: it is not waited for
    gate.depth(7, 5.0)
    gate.image(7)
    assert gate.seen()[-1] == (7, 5.0)


def test_depth_of_a_camera_beside_is_placed_by_tf():
    gate = deep()
    gate.send("depth/camera_info", camera_to_info(DEPTH_CAMERA, 1, "depth_optical"))
    gate.image(1)
    gate.depth(1, shape=(6, 12), frame="depth_optical")
    assert gate.seen() == [(1, None)]  # nobody says where it is: the image does not suffer from that
    assert "depth_optical" in gate.refusal()
    gate.send("tf_static", TFMessage(transforms=[se3_to_transform(T_IMAGE_DEPTH, SECOND, "optical", "depth_optical")]))
    gate.image(2)
    gate.depth(2, shape=(6, 12), frame="depth_optical")
    found = gate.pictures[-1].depth
    assert found.camera == DEPTH_CAMERA
    np.testing.assert_allclose(found.T_image_depth.matrix, T_IMAGE_DEPTH.matrix, atol=1e-12)


def test_depth_that_cannot_be_read_costs_no_image():
    gate = deep()
    gate.image(1)
    gate.depth(1, shape=(6, 12))
    assert gate.seen() == [(1, None)]
    assert "expected 16 x 8" in gate.refusal()


def test_after_a_jump_of_the_clock_nothing_old_is_joined():
    gate = deep()
    gate.image(5)
    gate.intake.clear()
    gate.depth(5)
    gate.image(6)
    gate.depth(6, 3.0)
    assert gate.seen() == [(6, 3.0)]
