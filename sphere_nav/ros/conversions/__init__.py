"""Every crossing between messages and arrays, one file a kind of message.

Nothing else touches the fields of a message. What cannot be converted raises ValueError: field, expected,
found. Arrays read from a message may be views into it: read-only.
"""

from sphere_nav.ros.conversions.cameras import as_rectified as as_rectified
from sphere_nav.ros.conversions.cameras import camera_from_info as camera_from_info
from sphere_nav.ros.conversions.cameras import camera_to_info as camera_to_info
from sphere_nav.ros.conversions.cameras import check_image_size as check_image_size
from sphere_nav.ros.conversions.cameras import has_baseline as has_baseline
from sphere_nav.ros.conversions.cameras import is_rectified_topic as is_rectified_topic
from sphere_nav.ros.conversions.cameras import rectification_of as rectification_of
from sphere_nav.ros.conversions.cameras import stereo_baseline as stereo_baseline
from sphere_nav.ros.conversions.clouds import cloud_to_message as cloud_to_message
from sphere_nav.ros.conversions.clouds import message_to_cloud as message_to_cloud
from sphere_nav.ros.conversions.graphs import graph_to_message as graph_to_message
from sphere_nav.ros.conversions.graphs import message_to_graph as message_to_graph
from sphere_nav.ros.conversions.headers import header as header
from sphere_nav.ros.conversions.headers import ns_to_time as ns_to_time
from sphere_nav.ros.conversions.headers import stamp_ns as stamp_ns
from sphere_nav.ros.conversions.headers import time_to_ns as time_to_ns
from sphere_nav.ros.conversions.images import Levels as Levels
from sphere_nav.ros.conversions.images import array_to_image as array_to_image
from sphere_nav.ros.conversions.images import depth_to_meters as depth_to_meters
from sphere_nav.ros.conversions.images import image_to_array as image_to_array
from sphere_nav.ros.conversions.images import image_to_rgb as image_to_rgb
from sphere_nav.ros.conversions.poses import from_ros_covariance as from_ros_covariance
from sphere_nav.ros.conversions.poses import move_covariance as move_covariance
from sphere_nav.ros.conversions.poses import odometry_to_se3 as odometry_to_se3
from sphere_nav.ros.conversions.poses import path_to_poses as path_to_poses
from sphere_nav.ros.conversions.poses import point_to_array as point_to_array
from sphere_nav.ros.conversions.poses import pose_to_se3 as pose_to_se3
from sphere_nav.ros.conversions.poses import pose_with_covariance_to_se3 as pose_with_covariance_to_se3
from sphere_nav.ros.conversions.poses import poses_to_path as poses_to_path
from sphere_nav.ros.conversions.poses import se3_to_odometry as se3_to_odometry
from sphere_nav.ros.conversions.poses import se3_to_pose as se3_to_pose
from sphere_nav.ros.conversions.poses import se3_to_pose_stamped as se3_to_pose_stamped
from sphere_nav.ros.conversions.poses import se3_to_pose_with_covariance as se3_to_pose_with_covariance
from sphere_nav.ros.conversions.poses import se3_to_transform as se3_to_transform
from sphere_nav.ros.conversions.poses import to_ros_covariance as to_ros_covariance
from sphere_nav.ros.conversions.poses import transform_to_se3 as transform_to_se3
from sphere_nav.ros.conversions.spheres import camera_to_sphere_info as camera_to_sphere_info
from sphere_nav.ros.conversions.spheres import message_to_sphere as message_to_sphere
from sphere_nav.ros.conversions.spheres import sphere_info_to_camera as sphere_info_to_camera
from sphere_nav.ros.conversions.spheres import sphere_to_message as sphere_to_message
from sphere_nav.ros.conversions.status import message_to_status as message_to_status
from sphere_nav.ros.conversions.status import status_to_message as status_to_message
