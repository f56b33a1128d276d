import pytest

pytest.importorskip("rclpy")

from node_kit.node import ManagedNode
from node_kit.replay import OfflineBus
from sphere_mapping.intake_node import TOPICS, Intake
from sphere_mapping.params import SphereMapperParams
from worlds.recordings import rgbd, sphere, stereo


class Catcher(ManagedNode):
    NAME, PARAMS = "catcher", SphereMapperParams

    def configure(self):
        self.caught = []
        self.intake = Intake(self.params, lambda *what: self.caught.append(what))
        for subscription in self.intake.subscriptions():
            self.add_subscription(*subscription)


def caught(kind, *messages):
    bus = OfflineBus()
    node = bus.add(Catcher, {"input": kind})
    for topic, message in messages:
        bus.publish("/" + topic, message)
    list(bus.settle())
    return node


@pytest.mark.parametrize(
    ("kind", "source", "frame_id", "is_optical"),
    [
        ("sphere", sphere, "sphere_link", False),
        ("rgbd", rgbd, "camera_optical", True),
        ("stereo", stereo, "camera_optical", True),
    ],
)
def test_every_kind_gives_spheres_with_stamp_and_frame(kind, source, frame_id, is_optical):
    node = caught(kind, *source(3))
    ((found, frame, optical),) = node.caught
    assert found.stamp_ns == 1_300_000_000
    assert (frame, optical) == (frame_id, is_optical)
    assert found.measured.mean() > 0.5
    assert {wanted.topic for wanted in node.inputs} == set(TOPICS[kind])


def test_an_image_before_its_camera_info_is_refused():
    messages = dict(rgbd(0))
    order = ("image_raw", "depth/image_raw", "camera_info")
    node = caught("rgbd", *((topic, messages[topic]) for topic in order))
    assert node.caught == []
    assert any("expected before the first image" in wanted.last_refusal for wanted in node.inputs)


def test_a_right_camera_without_a_baseline_is_refused():
    messages = dict(stereo(0))
    messages["right/camera_info"].p[3] = 0.0
    node = caught("stereo", *messages.items())
    assert node.caught == []
    assert any("expected -fx * baseline < 0, found 0.0" in wanted.last_refusal for wanted in node.inputs)


def test_half_an_instant_waits_and_is_forgotten_when_the_clock_jumps():
    first, second = dict(rgbd(0)), dict(rgbd(1))
    node = caught("rgbd", ("camera_info", first["camera_info"]), ("depth/image_raw", first["depth/image_raw"]))
    node.intake.clear()
    for wanted in node.inputs:
        if wanted.topic in ("image_raw", "depth/image_raw"):
            wanted.deliver(first["image_raw"] if wanted.topic == "image_raw" else second["depth/image_raw"])
    assert node.caught == []
