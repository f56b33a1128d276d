"""Every crossing between messages and arrays, one file a kind of message.

Nothing else touches the fields of a message. What cannot be converted raises ValueError: field, expected,
found. Arrays read from a message may be views into it: read-only.
"""

from sphere_nav.ros.conversions.cameras import (
    as_rectified,
    camera_from_info,
    camera_to_info,
    check_image_size,
    has_baseline,
    is_rectified_topic,
    rectification_of,
    stereo_baseline,
)
from sphere_nav.ros.conversions.clouds import cloud_to_message, message_to_cloud
from sphere_nav.ros.conversions.graphs import graph_to_message, message_to_graph
from sphere_nav.ros.conversions.images import (
    Levels,
    array_to_image,
    compressed_to_array,
    decompress,
    depth_to_meters,
    image_to_array,
    image_to_rgb,
)
from sphere_nav.ros.conversions.poses import (
    from_ros_covariance,
    move_covariance,
    odometry_to_se3,
    path_to_poses,
    point_to_array,
    pose_to_se3,
    pose_with_covariance_to_se3,
    poses_to_path,
    se3_to_odometry,
    se3_to_pose,
    se3_to_pose_stamped,
    se3_to_pose_with_covariance,
    se3_to_transform,
    to_ros_covariance,
    transform_to_se3,
)
from sphere_nav.ros.conversions.spheres import (
    camera_to_sphere_info,
    message_to_sphere,
    sphere_info_to_camera,
    sphere_to_message,
)
from sphere_nav.ros.conversions.stamps import header, ns_to_time, stamp_ns, time_to_ns
from sphere_nav.ros.conversions.status import message_to_status, status_to_message

__all__ = [
    "Levels",
    "array_to_image",
    "as_rectified",
    "camera_from_info",
    "camera_to_info",
    "camera_to_sphere_info",
    "check_image_size",
    "cloud_to_message",
    "compressed_to_array",
    "decompress",
    "depth_to_meters",
    "from_ros_covariance",
    "graph_to_message",
    "has_baseline",
    "header",
    "image_to_array",
    "image_to_rgb",
    "is_rectified_topic",
    "message_to_cloud",
    "message_to_graph",
    "message_to_sphere",
    "message_to_status",
    "move_covariance",
    "ns_to_time",
    "odometry_to_se3",
    "path_to_poses",
    "point_to_array",
    "pose_to_se3",
    "pose_with_covariance_to_se3",
    "poses_to_path",
    "rectification_of",
    "se3_to_odometry",
    "se3_to_pose",
    "se3_to_pose_stamped",
    "se3_to_pose_with_covariance",
    "se3_to_transform",
    "sphere_info_to_camera",
    "sphere_to_message",
    "stamp_ns",
    "status_to_message",
    "stereo_baseline",
    "time_to_ns",
    "to_ros_covariance",
    "transform_to_se3",
]
