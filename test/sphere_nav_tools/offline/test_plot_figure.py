"""What is drawn of a localiser's states, and what is said of them."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.localization.status import Reason, State, Status
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.maps.reader import MapDetails, save_map
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.plot_figure import (
    describe_experiences,
    draw_localization,
    find_experiences,
    runs_of,
)

SECOND = 1_000_000_000
STATES = [State.SEARCHING, State.PROBATION, State.TRACKING, State.TRACKING, State.DEGRADED, State.LOST]
REASONS = ["", "", "", "", Reason.LOW_OVERLAP, Reason.TIMEOUT]


def status(number):
    stamp = (number + 1) * SECOND
    return Status(STATES[number], REASONS[number], remedy="turn back", milliseconds=5.0 + number, stamp_ns=stamp)


def test_runs_of_equal_states_last_until_the_next_begins():
    runs = runs_of([status(number) for number in range(6)], SECOND)
    assert [(str(state), str(reason)) for state, reason, _, _ in runs] == [
        ("SEARCHING", ""), ("PROBATION", ""), ("TRACKING", ""), ("DEGRADED", "LOW_OVERLAP"), ("LOST", "TIMEOUT"),
    ]  # fmt: skip
    assert [(first, end) for _, _, first, end in runs] == [(0, 1), (1, 2), (2, 4), (4, 5), (5, 5)]
    assert runs_of([], 0) == []


@pytest.mark.slow
def test_it_is_told_which_experience_placed_an_image(tmp_path):
    sphere = Sphere(np.full((4, 8), 9, np.uint8), np.full((4, 8), 2.0, np.float32), Spherical(8, 4))
    looks = [Experience("night"), Experience("night", drive="other"), Experience(drive="monday")]
    nodes = [KeySphere(k, 0, SE3.identity(), sphere, experience=one) for k, one in enumerate(looks)]
    save_map(tmp_path / "map", SphereGraph(nodes), MapDetails("abc"))
    said = [replace(status(k), references=(k % 3, 0), map_id="abc") for k in range(5)]
    served = find_experiences(tmp_path / "map", said)
    assert served == {3 * SECOND: "monday", 4 * SECOND: "night", 5 * SECOND: "night (2)"}  # what was placed
    assert describe_experiences(served)[0] == "     1  placed by monday"
    draw_localization(tmp_path / "a.svg", trajectory(), None, said, served)
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert drawn.count("by night (2)") == 1
    with pytest.raises(BagError, match="map_id: expected that of the recording, xyz, found abc"):
        find_experiences(tmp_path / "map", [replace(said[0], map_id="xyz")])


def trajectory():
    stamps = np.arange(1, 6) * SECOND
    return Trajectory(stamps, SE3(np.stack([SE3.from_planar(0.1 * k, 0.0, 0.0).matrix for k in range(5)])))
