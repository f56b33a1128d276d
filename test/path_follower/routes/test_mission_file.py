"""What of a mission survives: it comes back as it was; what is no such file is refused in one line."""

import json

import numpy as np
import pytest

from path_follower.params import FollowerParams, VehicleParams
from path_follower.path import Pose2
from path_follower.path_files import read_path
from path_follower.routes.course import make_course
from path_follower.routes.mission import FollowerView, Goal, Mission
from path_follower.routes.mission_file import read_mission, write_course, write_mission
from path_follower.routes.network import Spot
from path_follower.routes.params import MissionParams
from path_follower.routes.planning import Leg, Route, plan
from sphere_nav.geometry.trajectory import read_map_id


def mission_of(network):
    mission = Mission(network, MissionParams(), VehicleParams())
    mission.see_follower(FollowerView("NO_PATH", 7))
    return mission


@pytest.fixture
def file(fork, tmp_path):
    mission = mission_of(fork)
    mission.begin(Goal("", Pose2(30.0, 0.0, 0.0), laps=0, wait=2.0), 0.0)
    mission.close(str(max(fork.edges)), True, 0.0)
    mission.course = make_course(
        fork, plan(fork, [Spot(min(fork.edges), 1.0)], fork.spots_of(3), cruise=1.0).legs, None, VehicleParams()
    )
    mission.driven = 12.5
    write_mission(tmp_path / "mission.json", mission)
    return tmp_path / "mission.json"


def test_a_mission_comes_back_as_it_was(file, fork):
    mission = mission_of(fork)
    read_mission(file, mission, 5.0)
    assert mission.goal == Goal("", Pose2(30.0, 0.0, 0.0), laps=0, wait=2.0)
    assert (mission.closed, mission.driven, mission.permission) == ({max(fork.edges)}, 12.5, 7)
    assert mission.course.legs[0].edge == min(fork.edges)
    assert mission.course.length == pytest.approx(mission.course.ends[-1])
    assert [path.name for path in file.parent.iterdir()] == ["mission.json"]


def test_what_is_left_of_a_mission_comes_back(fork, tmp_path):
    mission = mission_of(fork)
    mission.begin(Goal("home", laps=3, wait=1.5), 0.0)
    (first, *_), legs = fork.edges.values(), [Leg(min(fork.edges), -1, 7.0, 2.0), Leg(min(fork.edges), 1, 2.0, 9.0)]
    mission.course = make_course(fork, legs, None, VehicleParams())
    mission._route, mission._lap_legs, mission.laps_left = Route(tuple(legs), 24.0), (1, 2), 2
    write_mission(tmp_path / "mission.json", mission)
    found = mission_of(fork)
    read_mission(tmp_path / "mission.json", found, 5.0)
    assert (found.goal, found.laps_left, found._lap_legs) == (mission.goal, 2, (1, 2))
    assert list(found.course.legs) == legs
    assert (found.distance_remaining, found.time_remaining) == (pytest.approx(12.0), pytest.approx(24.0))
    assert first.length > 9.0


BROKEN = {
    "map_id: expected that of the network": {"map_id": "hall"},
    "expected format 'sphere_nav mission' version 1": {"version": 7},
    "legs: expected": {"legs": []},
    "goal.place: expected a name": {"goal": {"place": 5, "pose": None, "laps": 0, "wait": 0}},
    "goal.laps: expected 0 to 65535": {"goal": {"place": "a", "pose": None, "laps": -1, "wait": 0}},
    "goal.pose: expected 3 numbers": {"goal": {"place": "", "pose": [1], "laps": 0, "wait": 0}},
    "ends: expected a list of numbers": {"ends": "x"},
    "driven: expected a finite number": {"driven": "nan"},
}


def test_what_is_no_mission_is_refused(file, fork):
    whole = json.loads(file.read_text())
    for text, change in BROKEN.items():
        file.write_text(json.dumps(whole | change))
        mission = mission_of(fork)
        with pytest.raises(ValueError, match=text):
            read_mission(file, mission, 0.0)
        assert mission.goal is None


def test_a_course_is_what_the_follower_reads(fork, tmp_path):
    course = make_course(
        fork, plan(fork, [Spot(min(fork.edges), 1.0)], fork.spots_of(3), cruise=1.0).legs, None, VehicleParams()
    )
    course.speed[:50] = np.nan
    write_course(tmp_path / "course.csv", course, "campus")
    path = read_path(tmp_path / "course.csv", FollowerParams())
    assert read_map_id(tmp_path / "course.csv") == "campus"
    assert path.length == pytest.approx(course.length, abs=0.05)
    assert path.possible[10] == pytest.approx(FollowerParams().vehicle.max_speed, abs=0.1)
