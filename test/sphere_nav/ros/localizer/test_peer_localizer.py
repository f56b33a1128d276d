"""Another localiser beside a node: compared, reported, and taken as an offer where it is wanted."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import se3_to_pose_with_covariance
from sphere_nav.ros.localizer.peer_localizer import PeerLocalizer
from sphere_nav.ros.node import ERROR, OK, ManagedNode

SECOND = 10**9
CERTAIN = 0.01 * np.eye(6)


class Lonely(ManagedNode):
    NAME = "lonely"

    def configure(self):
        self.offers, self.has_pose = [], True
        self.peer = PeerLocalizer(self.endpoints, "map", lambda: not self.has_pose, self.take)

    def take(self, T_map_base, covariance):
        if T_map_base.translation[0] > 90.0:
            raise ValueError("offer: expected a pose on the map, found one off it")
        self.offers.append(T_map_base)


@pytest.fixture
def bus():
    bus = OfflineBus()
    bus.add(Lonely)
    return bus


def other(bus, x, stamp, frame="map"):
    bus.deliver("/other/pose", se3_to_pose_with_covariance(SE3.from_planar(x, 0, 0), CERTAIN, stamp, frame))
    return bus.nodes[0]


def test_agreement_is_reported_and_contradiction_too(bus):
    node = other(bus, 0.1, SECOND)
    assert node.reports == {}
    node.peer.add_own(SECOND, SE3.identity(), CERTAIN)
    assert node.reports["agreement"][0] == OK
    node.peer.add_own(2 * SECOND, SE3.identity(), CERTAIN)
    other(bus, 2.0, 2 * SECOND)
    level, text, values = node.reports["agreement"]
    assert level == ERROR
    assert "2.00 m" in text
    assert values["distance"] == pytest.approx(2.0 / np.sqrt(0.02), rel=1e-3)
    assert node.offers == []  # it has a pose of its own


def test_an_offer_is_taken_once_a_second_where_there_is_no_pose(bus):
    bus.nodes[0].has_pose = False
    for stamp in (SECOND, SECOND + SECOND // 2, 2 * SECOND + 1):
        node = other(bus, 1.0, stamp)
    assert len(node.offers) == 2


def test_what_cannot_be_used_is_refused_in_words(bus):
    node = bus.nodes[0]
    node.has_pose = False
    told = node.inputs[0]
    other(bus, 99.0, SECOND)
    assert "off it" in told.last_refusal
    other(bus, 1.0, 3 * SECOND, "odom")
    assert "frame_id" in told.last_refusal
    assert node.offers == []
