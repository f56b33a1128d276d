"""What viewers get about one image."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.ros.views import Views
from sphere_nav.ros.bags.replay import OfflineBus
from worlds.mcl import Bench, Eye, drive, room_points

TOPICS = {"/particle_cloud", "/heading", "/hypotheses", "/similarity", "/synthesized_depth"}


@pytest.mark.slow
def test_every_image_is_shown(tmp_path):
    np.save(tmp_path / "room.npy", room_points(0.08))
    bench = Bench(Eye(), tmp_path / "room.npy", bus=OfflineBus(None))
    assert isinstance(bench.node.views, Views)
    answer = bench.see(drive()[0])
    assert set(answer) & TOPICS == TOPICS
    assert sum(particle.weight for particle in answer["/particle_cloud"].particles) == pytest.approx(1.0)
    assert all(np.isfinite(answer["/similarity"].ranges))
