"""Frames by the names that are meant."""

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry, Path
from rclpy.serialization import serialize_message
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.msg import SphereInfo
from sphere_nav_msgs.srv import Relocalize
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from sphere_nav.ros import qos
from sphere_nav.ros.conversions.headers import plain_frames
from sphere_nav.ros.interfaces import from_bytes
from sphere_nav.ros.service import answer_always
from sphere_nav.ros.subscription import Subscription


def messages():
    """One of each shape: header, child, a list with headers, a name of its own; and one without any."""
    odometry = Odometry(child_frame_id="/base_link")
    odometry.header.frame_id = "/odom"
    transform = TransformStamped(child_frame_id="/cam")
    transform.header.frame_id = "/base_link"
    pose = PoseStamped()
    pose.header.frame_id = "//map"
    return [odometry, TFMessage(transforms=[transform]), Path(poses=[pose]), SphereInfo(frame_id="/a/b"), String()]


def test_leading_slashes_go_wherever_a_message_comes_from():
    heard = []
    for message, again in zip(messages(), messages(), strict=True):
        Subscription("any", type(message), heard.append, qos.SENSOR).deliver(message)
        heard.append(from_bytes(serialize_message(again), type(again)))
    odometry, _, tree, _, path, _, sphere, _, _, _ = heard
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert (tree.transforms[0].header.frame_id, tree.transforms[0].child_frame_id) == ("base_link", "cam")
    assert (path.poses[0].header.frame_id, sphere.frame_id) == ("map", "a/b")
    assert heard[::2] == heard[1::2]
    assert plain_frames(Odometry()) == Odometry()


def test_leading_slashes_go_from_what_is_asked():
    request, goal = Relocalize.Request(), Navigate.Goal()
    request.guess.header.frame_id = goal.pose.header.frame_id = "/map"
    answer = answer_always(lambda asked, response: asked.guess.header.frame_id, "relocalize", None)
    assert answer(request, Relocalize.Response()) == "map"
    assert plain_frames(goal).pose.header.frame_id == "map"
