"""What a user may get wrong is a refused message or a status; never a pose, never a crash."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav.ros.conversions import cloud_to_message
from worlds.mcl import SECOND, Bench, Eye, room_points


@pytest.fixture(scope="module")
def eye():
    return Eye()


def test_a_cloud_by_topic_without_coordinates_or_with_a_point_far_outside_is_refused(eye):
    bench, message = Bench(eye), cloud_to_message(room_points(0.5), SECOND, "map")
    message.fields[2].name = "intensity"
    stray = cloud_to_message(np.vstack([room_points(0.5), [0.0, 5e4, 0.0]]), SECOND, "map")
    nothing = cloud_to_message(np.full((50, 3), np.nan), SECOND, "map")
    for sent, said in (
        (message, "field of numbers 'z'"),
        (stray, "expected one place, found 99.9%"),
        (nothing, "at least one finite point"),
    ):
        bench.send("/cloud", sent)
        assert bench.node.clouds.geometry is None
        assert said in next(item.last_refusal for item in bench.node.inputs if item.topic == "cloud")
