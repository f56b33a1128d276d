import pytest

pytest.importorskip("rclpy")

from sphere_nav_msgs.srv import LoadMap, Relocalize
from std_srvs.srv import Trigger

from dense_localizer.calls_node import OperatorCalls
from dense_localizer.node import DenseLocalizerNode
from node_kit.replay import OfflineBus


@pytest.fixture
def calls():
    return OperatorCalls(OfflineBus().add(DenseLocalizerNode))


def test_without_a_map_nothing_can_be_searched(calls):
    answer = calls.on_relocalize(Relocalize.Request(), Relocalize.Response())
    assert (answer.success, answer.message) == (False, "relocalize: expected a map, found none: load one first")


def test_a_map_that_is_not_there_is_one_line(calls, tmp_path):
    answer = calls.on_load_map(LoadMap.Request(path=str(tmp_path / "none")), LoadMap.Response())
    assert not answer.success
    assert "none" in answer.message
    assert "\n" not in answer.message


def test_reset_is_always_possible(calls):
    assert calls.on_reset(Trigger.Request(), Trigger.Response()).success
