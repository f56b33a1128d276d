"""Who confirms a command: the follower, by what it says after the command, not before."""

from itertools import chain, repeat
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Point, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sphere_nav_msgs.msg import ReferencePoint, ReferenceTrajectory

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import array_to_image, se3_to_pose_with_covariance
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.words import Heard

STOPPED = SimpleNamespace(state="STOPPED", reason="OPERATOR")
OLD, NEW = 1000.0, 0.0  # s since it was heard


@pytest.mark.parametrize(
    ("state", "ages", "told"),
    [
        ("STOPPED", chain([OLD] * 3, repeat(NEW)), "STOPPED OPERATOR"),
        ("STOPPED", repeat(OLD), "NOT CONFIRMED"),
        ("DRIVING", repeat(NEW), "NOT CONFIRMED"),
    ],
    ids=["after", "before", "another"],
)
def test_what_the_follower_said_before_a_command_does_not_confirm_it(monkeypatch, state, ages, told):
    monkeypatch.setattr("sphere_nav_tools.cli.operate.link.CONFIRMED_S", 60.0 if told == "STOPPED OPERATOR" else 0.2)
    link, heard = Link.__new__(Link), []

    def tell(name):
        heard.append(next(ages))
        return STOPPED, heard[-1]

    link.seen = SimpleNamespace(told=tell)
    assert link._confirmed(lambda status: status.state == state).startswith(told)
    assert told == "NOT CONFIRMED" or heard == [OLD] * 3 + [NEW]


@pytest.fixture
def ears():
    """A link that hears, without a node."""
    link = Link.__new__(Link)
    link.seen = Heard()
    return link


def test_the_way_grows_by_steps_of_ten_centimetres(ears):
    for x in (0.0, 0.09, 0.11, 0.15, 0.2, 0.22):
        message = Odometry()
        message.pose.pose.position = Point(x=x, y=-2.0 * x)
        ears._on_odometry(message)
    way = np.array(ears.seen.told("odometry")[0])
    np.testing.assert_allclose(way, [[0.0, 0.0], [0.09, -0.18], [0.15, -0.3], [0.2, -0.4]])


def test_of_a_long_way_the_end_is_kept(ears):
    ears.seen.hear("odometry", [np.array([0.2 * k, 0.0]) for k in range(20_000)])
    for k in range(3):
        ears._grow("odometry", np.array([4000.0 + k, 0.0]))
    way = ears.seen.told("odometry")[0]
    assert len(way) == 20_001
    assert (way[0][0], way[-1][0]) == (pytest.approx(0.4), 4002.0)


def test_a_pose_is_told_with_its_heading_and_covariance(ears):
    covariance = np.diag([0.04, 0.01, 0.1, 1.0, 1.0, 1.0])
    covariance[0, 1] = covariance[1, 0] = 0.005
    message = se3_to_pose_with_covariance(SE3.from_planar(3.0, -4.0, 0.7), covariance, 5, "map")
    assert isinstance(message, PoseWithCovarianceStamped)
    ears._on_pose(message)
    x, y, yaw, told = ears.seen.told("pose")[0]
    assert (x, y, yaw) == pytest.approx((3.0, -4.0, 0.7))
    np.testing.assert_array_equal(told, np.reshape(message.pose.covariance, (6, 6))[:2, :2])
    assert ears.seen.told("trail")[0][0].tolist() == [3.0, -4.0]


@pytest.mark.parametrize("is_closed", [False, True])
def test_a_closed_path_ends_where_it_begins(ears, is_closed):
    points = [ReferencePoint(position_x=x, position_y=y) for x, y in ((0.0, 1.0), (2.0, 3.0), (4.0, 5.0))]
    ears._on_path(ReferenceTrajectory(points=points, is_closed=is_closed))
    expected = [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0], [0.0, 1.0]]
    assert ears.seen.told("path")[0].tolist() == expected[: 3 + is_closed]


def test_a_picture_is_shown_for_two_seconds(ears, monkeypatch):
    assert ears.picture("image") is None
    gray = np.arange(12, dtype=np.uint8).reshape(3, 4)
    ears.seen.hear("image", array_to_image(gray, 5, "eye", "mono8"))
    np.testing.assert_array_equal(ears.picture("image"), gray)
    told, heard = ears.seen.told("image")
    for age, is_shown in ((1.9, True), (2.1, False)):
        monkeypatch.setattr(ears.seen, "told", lambda name, age=age: (told, age))
        assert (ears.picture("image") is not None) == is_shown
    broken = array_to_image(gray, 5, "eye", "mono8")
    broken.data = broken.data[:5]
    monkeypatch.setattr(ears.seen, "told", lambda name: (broken, heard))
    assert ears.picture("image") is None
