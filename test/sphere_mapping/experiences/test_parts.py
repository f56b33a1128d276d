"""Drives joined to a map by parts of their images, where other boxes stand and light turns the contrast."""

import numpy as np
import pytest

from sphere_mapping.experiences import parts
from sphere_mapping.experiences.joining import Localized, join_drive
from sphere_nav.geometry import SE3
from worlds.nightfall import DAY, ELSEWHERE, NIGHT, make_submap
from worlds.submaps import images_of

pytestmark = pytest.mark.slow

BASE = [SE3.from_planar(-2.4 + 0.8 * k, 0.0, 0.0) for k in range(5)]
DRIVE = [SE3.from_planar(-2.1 + 0.8 * k, 0.15, 0.06) for k in range(4)]
FAR = SE3.from_planar(5.0, -3.0, 1.2)  # where the drive thinks it began


@pytest.fixture(scope="module")
def base():
    return make_submap(DAY, BASE, 0, is_dark=False)


@pytest.fixture(scope="module")
def night():
    return make_submap(NIGHT, DRIVE, 100, FAR, is_dark=True)


def images(drive, located=()):
    return images_of(
        drive, {100 + k: Localized(0, BASE[0].inverse() @ DRIVE[k], 1e-6 * np.eye(6), is_sure=True) for k in located}
    )


def off(edge):
    return (BASE[edge.a].inverse() @ DRIVE[edge.b - 100]).distance(edge.T_a_b)[0]


def test_a_drive_is_found_from_nowhere(base, night, monkeypatch):
    monkeypatch.setattr(parts, "guess_headings", lambda *_: np.array([0.0]))
    edges = parts.search_by_parts(base, night, lambda _: None)
    assert len(edges) >= 3
    assert max(off(edge) for edge in edges) < 0.05


def test_where_the_localizer_placed_part_of_a_drive_parts_of_the_images_join_the_rest(base, night):
    joined = join_drive(base, night, images(night, (0, 1, 2)))
    assert "the localizer placed 3 of 4" in joined.told
    assert "parts of the images agree at 4 of 4 key spheres" in joined.told
    assert max(joined.graph[100 + k].T_map_sphere.distance(pose)[0] for k, pose in enumerate(DRIVE)) < 0.05


def test_a_wrong_start_of_another_place_is_refused(base):
    other = make_submap(ELSEWHERE, DRIVE, 100, FAR, is_dark=True)
    assert join_drive(base, other, images(other), DRIVE[0]).graph is None
