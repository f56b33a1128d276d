"""What a localiser believes, for RViz and Foxglove: places with their spread as markers, particles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from sphere_nav_msgs.msg import Particle, ParticleCloud
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.ros.conversions.headers import header
from sphere_nav.ros.conversions.poses import se3_to_pose

COLORS = ColorRGBA(r=0.1, g=0.8, b=0.2, a=0.6), ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.6)  # the best, others
THICKNESS = 0.05  # m, of what is drawn


def hypotheses_to_markers(
    hypotheses: Sequence[Any], heights: Sequence[float], stamp: int, frame_id: str
) -> MarkerArray:
    """Return places by falling weight: an ellipse of two standard deviations, an arrow and the weight of each.

    A hypothesis has `pose` (3,) x, y, yaw, `covariance` (3, 3) in the map's axes and `weight`; heights in m.
    """
    head = header(stamp, frame_id)
    markers = [Marker(header=head, action=Marker.DELETEALL)]
    for number, (item, height) in enumerate(zip(hypotheses, heights, strict=True)):
        color = COLORS[number > 0]
        values, axes = np.linalg.eigh(item.covariance[:2, :2])
        turn = math.atan2(axes[1, 1], axes[0, 1])
        place = *item.pose[:2], height
        tilted, heads = (SE3.from_angles(0.0, 0.0, float(yaw), place) for yaw in (turn, item.pose[2]))
        long, short = (4.0 * max(math.sqrt(max(v, 0.0)), 0.01) for v in (values[1], values[0]))
        ellipse = make_marker(head, "places", Marker.CYLINDER, color, (long, short, THICKNESS), tilted, number)
        arrow = make_marker(head, "headings", Marker.ARROW, color, (1.0, THICKNESS, THICKNESS), heads, number)
        text = make_marker(head, "weights", Marker.TEXT_VIEW_FACING, color, (0.0, 0.0, 0.4), heads, number)
        text.text = f"{float(item.weight):.0%}"
        markers += [ellipse, arrow, text]
    return MarkerArray(markers=markers)


def make_marker(
    head: Header,
    name: str,
    kind: int,
    color: ColorRGBA,
    scale: tuple[float, float, float],
    T_frame_marker: SE3,
    number: int = 0,
) -> Marker:
    """Return a marker that is added; scale in m, what each number means depends on its kind."""
    marker = Marker(header=head, ns=name, id=number, type=kind, action=Marker.ADD, color=color)
    marker.pose = se3_to_pose(T_frame_marker)
    marker.scale.x, marker.scale.y, marker.scale.z = scale
    return marker


def particles_to_message(poses: Array, weights: Array, stamp: int, frame_id: str) -> ParticleCloud:
    """Return the cloud of poses (N, 3) x, y, yaw with weights (N,)."""
    particles = [
        Particle(pose=se3_to_pose(SE3.from_planar(float(x), float(y), float(yaw))), weight=float(weight))
        for (x, y, yaw), weight in zip(poses, weights, strict=True)
    ]
    return ParticleCloud(header=header(stamp, frame_id), particles=particles)
