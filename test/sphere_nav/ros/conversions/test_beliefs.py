"""Places as markers, similarities as a polar curve."""

from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.ros.conversions.beliefs import hypotheses_to_markers, similarities_to_scan


def test_every_place_is_an_ellipse_an_arrow_and_a_weight():
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    covariance = turned @ np.diag([0.25, 0.04, 0.01]) @ turned.T  # longest along y
    places = [
        SimpleNamespace(pose=np.array([1.0, 2.0, 0.5]), covariance=covariance, weight=0.8),
        SimpleNamespace(pose=np.array([5.0, 2.0, 0.5]), covariance=np.zeros((3, 3)), weight=0.2),
    ]
    first, *markers = hypotheses_to_markers(places, [1.5, 1.6], 7, "map").markers
    assert first.action == first.DELETEALL  # places that are no more vanish
    names = ("places", "headings", "weights")
    assert [(marker.ns, marker.id) for marker in markers] == [(name, number) for number in (0, 1) for name in names]
    ellipse, arrow, text = markers[:3]
    assert (ellipse.scale.x, ellipse.scale.y) == pytest.approx((2.0, 0.8))  # two standard deviations to either side
    turn = 2 * np.arctan2(ellipse.pose.orientation.z, ellipse.pose.orientation.w)
    assert abs(np.cos(turn)) < 1e-9
    heading = 2 * np.arctan2(arrow.pose.orientation.z, arrow.pose.orientation.w)
    assert heading == pytest.approx(0.5)
    assert (arrow.pose.position.x, arrow.pose.position.y, arrow.pose.position.z) == (1.0, 2.0, 1.5)
    assert text.text == "80%"
    assert min(markers[3].scale.x, markers[3].scale.y) > 0.0


@pytest.mark.parametrize("yaw", [0.3, -3.1])
def test_a_turned_vehicle_sees_the_curve_peak_where_it_heads(yaw):
    angles = np.arange(36) * np.radians(10.0)
    curve = 1.0 + 0.5 * np.cos(angles - 1.0)
    scan = similarities_to_scan(curve, yaw, 3, "base_link")
    seen = scan.angle_min + scan.angle_increment * np.arange(36)
    assert -np.pi - 1e-6 <= seen[0] <= seen[-1] <= np.pi + 1e-6
    assert scan.angle_max == pytest.approx(seen[-1])
    np.testing.assert_allclose(scan.ranges, 1.0 + 0.5 * np.cos(seen + yaw - 1.0), atol=1e-5)
