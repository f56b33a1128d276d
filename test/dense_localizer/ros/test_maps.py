"""A map that is refused changes nothing, and is closed."""

import pytest

pytest.importorskip("rclpy")

from sphere_nav_msgs.srv import LoadMap
from std_srvs.srv import Trigger

from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.ros.bags.replay import OfflineBus


def test_a_map_that_is_not_there_is_named_in_one_line(tmp_path):
    node = OfflineBus().add(DenseLocalizerNode)
    answer = node.shell.call("load_map", LoadMap.Request(path=str(tmp_path / "none")))
    assert not answer.success
    assert "none" in answer.message
    assert "\n" not in answer.message
    assert (node.maps.reader, node.localizer) == (None, None)


def test_without_a_map_nothing_can_be_searched_and_everything_reset():
    node = OfflineBus().add(DenseLocalizerNode)
    answer = node.shell.call("relocalize")
    assert (answer.success, answer.message) == (False, "relocalize: expected a map, found none: load one first")
    assert node.shell.call("reset", Trigger.Request()).success
