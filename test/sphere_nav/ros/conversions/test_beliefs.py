"""Places as markers."""

from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.ros.conversions.beliefs import hypotheses_to_markers


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
