"""A map that is refused changes nothing, and is closed."""

from sphere_nav_msgs.srv import LoadMap
from std_srvs.srv import Trigger

from dense_localizer.ros.maps import UNREADABLE
from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.ros.bags.replay import OfflineBus


def test_of_a_file_that_is_no_map_nothing_is_told_to_who_asks(tmp_path, caplog):
    node, told = OfflineBus().add(DenseLocalizerNode), set()
    (tmp_path / "secret.mcap").write_text("the secret")
    (tmp_path / "metadata.yaml").write_text("the secret")
    paths = ("secret.mcap", "none", "metadata.yaml", "metadata.yaml/x", ".", "", "a\0b")
    for path in (*(str(tmp_path / name) for name in paths), "/dev/null", "/proc/self/mem", "/etc/passwd"):
        answer = node.endpoints.call("load_map", LoadMap.Request(path=path))
        told.add((answer.success, answer.message))
    assert told == {(False, UNREADABLE)}
    assert "secret.mcap: expected an MCAP file, found one of another kind" in caplog.text
    assert (node.maps.reader, node.localizer) == (None, None)


def test_without_a_map_nothing_can_be_searched_and_everything_reset():
    node = OfflineBus().add(DenseLocalizerNode)
    answer = node.endpoints.call("relocalize")
    assert (answer.success, answer.message) == (False, "relocalize: expected a map, found none: load one first")
    assert node.endpoints.call("reset", Trigger.Request()).success
