"""Which topics belong together in a recording, by their type."""

from __future__ import annotations

STATIC = "/tf_static"

SETS: dict[str, frozenset[str]] = {
    "raw": frozenset(
        {
            "nav_msgs/msg/Odometry",
            "sensor_msgs/msg/CameraInfo",
            "sensor_msgs/msg/CompressedImage",
            "sensor_msgs/msg/Image",
            "sensor_msgs/msg/Imu",
            "sensor_msgs/msg/LaserScan",
            "tf2_msgs/msg/TFMessage",
        }
    ),
    "spheres": frozenset(
        {
            "sphere_nav_msgs/msg/AugmentedSphere",
            "sphere_nav_msgs/msg/KeySphereGraph",
            "sphere_nav_msgs/msg/MapInfo",
        }
    ),
    "localisation": frozenset(
        {
            "diagnostic_msgs/msg/DiagnosticArray",
            "geometry_msgs/msg/PoseStamped",
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            "nav_msgs/msg/Odometry",
            "sphere_nav_msgs/msg/LocalizationStatus",
            "sphere_nav_msgs/msg/ParticleCloud",
            "tf2_msgs/msg/TFMessage",
        }
    ),
    "control": frozenset(
        {
            "ackermann_msgs/msg/AckermannDriveStamped",
            "geometry_msgs/msg/Twist",
            "geometry_msgs/msg/TwistStamped",
            "nav_msgs/msg/Path",
            "sphere_nav_msgs/msg/FollowerStatus",
            "sphere_nav_msgs/msg/NavigatorStatus",
            "sphere_nav_msgs/msg/ReferenceTrajectory",
            "sphere_nav_msgs/msg/TrackingError",
        }
    ),
}
ALL = "all"
NAMES = ("", ALL, *SETS)


def belongs(topic: str, kind: str, chosen: str) -> bool:
    """Return whether a topic of a type is in the set `chosen`; hidden topics (/_name) are in none."""
    if any(part.startswith("_") for part in topic.split("/")):
        return False
    return chosen == ALL or (chosen in SETS and (kind in SETS[chosen] or topic == STATIC))
