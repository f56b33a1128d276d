"""What one sphere is good for: what is measured of it; no image is drawn here."""

import numpy as np
import pytest

from sphere_nav.geometry import Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.cli.experiment.one_sphere import (
    MAX_MAD,
    Tried,
    by_reference,
    rank_correlation,
    ring_figures,
    spiral,
)

# Written out: imported, a change would go unseen.
CLEAR, FARTHEST = 0.6, 6.0

MIDDLE = np.array([3.0, -4.0, np.pi / 2])


def test_the_way_by_a_reference_goes_with_how_near_things_are():
    begins, nearness = np.array([0, 10, 14, 30]), np.repeat([np.nan, 0.1, 0.5, 0.05, 0.9], [1, 9, 4, 16, 5])
    ways, near = by_reference(begins, nearness)
    assert ways == pytest.approx([2.0, 0.8, 3.2])
    assert near == pytest.approx([0.1, 0.5, 0.05])
    assert rank_correlation(ways, near) == pytest.approx(-1.0)
    assert rank_correlation(ways, np.array([1.0, 3.0, 2.0])) == pytest.approx(-0.5)


def test_the_next_reference_begins_where_equation_12_says():
    assert MAX_MAD == 12.75  # 5 % of white


def sphere(left_m):
    """A sphere with so much room to the left, 20 m elsewhere."""
    camera = Spherical(72, 36)
    range_m = np.full((36, 72), 20.0, np.float32)
    range_m[:, 9:27] = left_m  # azimuth 90 deg, 45 deg to both sides
    return Sphere(np.full((36, 72), 9, np.uint8), range_m, camera)


def test_the_camera_is_moved_where_there_is_room():
    everywhere, beside = (np.array(list(spiral(MIDDLE, sphere(room)))) for room in (20.0, 2.0))
    assert len(everywhere) == 240
    assert np.hypot(*(everywhere[-1, :2] - MIDDLE[:2])) == pytest.approx(FARTHEST, abs=0.02)
    assert np.ptp(np.mod(everywhere[:, 2], 2 * np.pi)) > 6.0  # it looks everywhere
    left = beside[beside[:, 0] - MIDDLE[0] < -np.abs(beside[:, 1] - MIDDLE[1])]  # the sphere looks along y
    assert 1.1 < np.hypot(*(left[:, :2] - MIDDLE[:2]).T).max() < 2.0 - CLEAR
    assert len(beside) > 0.75 * 240


@pytest.mark.parametrize(("lost_at", "reach", "is_met"), [(4.2, 4.0, True), (3.2, 3.0, False), (9.0, 6.0, True)])
def test_a_sphere_reaches_as_far_as_whole_rings_are_found(lost_at, reach, is_met):
    radius = np.linspace(0.05, 5.95, 60)
    poses = np.column_stack([MIDDLE[0] + radius, np.full(60, MIDDLE[1]), np.zeros(60)])
    is_lost = (radius > lost_at) & (radius < lost_at + 0.2)
    tried = Tried(poses, np.where(is_lost, 0.4, 0.03), np.full(60, 0.2))
    found = {figure.name: figure for figure in ring_figures(tried, MIDDLE)}
    assert found["95 % of each ring found, up to"].value == reach
    assert found["95 % of each ring found, up to"].is_met is is_met
    assert found["error within that, RMSE"].value == pytest.approx(0.03)
    assert found["all poses found"].value == pytest.approx(100.0 * np.mean(~is_lost))
    unseen = Tried(poses, np.where(is_lost, np.nan, 0.03), np.where(radius < 1.0, 1.1, 0.2))
    assert next(f for f in ring_figures(unseen, MIDDLE) if "each ring" in f.name).value == 0.0  # turned too far
