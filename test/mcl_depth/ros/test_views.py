"""What viewers get about one image, and that the depth image costs nothing while nobody looks."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mcl_depth.ros.views import Views
from sphere_nav.ros.bags.replay import OfflineBus
from worlds.mcl import Bench, Eye, drive, room_points

TOPICS = {"/particle_cloud", "/heading", "/hypotheses", "/similarity", "/synthesized_depth"}


@pytest.mark.parametrize("is_looked_at", [True, False])
def test_every_image_is_shown(tmp_path, is_looked_at):
    np.save(tmp_path / "room.npy", room_points(0.08))
    bus = OfflineBus(None if is_looked_at else TOPICS - {"/synthesized_depth"})
    bench = Bench(Eye(), tmp_path / "room.npy", bus=bus)
    assert isinstance(bench.node.views, Views)
    answer = bench.see(drive()[0])
    assert set(answer) & TOPICS == (TOPICS if is_looked_at else TOPICS - {"/synthesized_depth"})
    assert sum(particle.weight for particle in answer["/particle_cloud"].particles) == pytest.approx(1.0)
    assert all(np.isfinite(answer["/similarity"].ranges))
