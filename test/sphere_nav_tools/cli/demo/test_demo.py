"""The demo's folder, verdict and table; the whole of it is run by `make demo`."""

import numpy as np
import pytest
import yaml

from cycab_sim.params import SimParams, in_condition
from sphere_nav.params import build
from sphere_nav_tools.cli.demo.demo import (
    BUSY,
    OTHER_DAY,
    SIMULATION,
    TEACHING,
    Demo,
    check_taught,
    has_ended,
    new_folder,
    result_table,
)
from sphere_nav_tools.cli.demo.report import DriveErrors


def verdict(tmp_path, lateral, share, has_finished=True):
    demo = Demo(tmp_path / "demo", 1, "straight", 46, {})
    demo.end, demo.has_finished, demo.num_key_spheres = "follower FINISHED", has_finished, 7
    path = np.zeros((3, 2))
    return demo, demo.result(DriveErrors(path, path, np.arange(3.0), np.array(lateral), np.zeros(3), share))


@pytest.mark.slow
def test_a_drive_on_the_path_to_its_end_has_followed(tmp_path):
    demo, result = verdict(tmp_path, [0.02, -0.05, 0.01], 0.99)
    assert result["has_followed"]
    assert result["lateral_max_m"] == 0.05
    assert "the drive followed" in result_table(result, demo.folder)


@pytest.mark.slow
def test_leaving_the_path_or_stopping_early_has_not(tmp_path):
    assert not verdict(tmp_path, [0.0, 0.3, 0.0], 1.0)[1]["has_followed"]
    demo, result = verdict(tmp_path, [0.0, 0.0, 0.0], 0.5)
    assert not result["has_followed"]
    assert "LEFT" in result_table(result, demo.folder)


@pytest.mark.slow
def test_a_drive_that_did_not_finish_is_not_good(tmp_path):
    demo, result = verdict(tmp_path, [0.0, 0.01, 0.0], 0.99, has_finished=False)
    assert not result["has_followed"]
    assert "DID NOT FINISH" in result_table(result, demo.folder)


def test_a_clock_that_was_held_up_is_no_end():
    assert has_ended("FINISHED END_OF_PATH")
    assert has_ended("STOPPED NOT_LOCALISED")
    assert not has_ended("STOPPED CLOCK_STOPPED")
    assert not has_ended("DRIVING")


def test_the_last_result_is_kept(tmp_path):
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "mine").touch()
    new_folder(tmp_path / "demo")
    assert (tmp_path / "demo.1" / "mine").exists()
    assert not any((tmp_path / "demo").iterdir())


@pytest.mark.slow
def test_the_tour_is_long_and_meets_another_day(tmp_path):
    demo = Demo(tmp_path / "demo", 1, "tour", 46, BUSY)
    assert round(demo.length) == 490
    assert demo.simulation["world"] == "city"
    assert demo.simulation["traffic.density"] == "busy"
    assert Demo(tmp_path / "plain", 1, "straight", 46, {}).simulation["traffic.density"] == "usual"
    assert {"traffic.seed", "light.clouds"} <= set(OTHER_DAY)


@pytest.mark.slow
def test_the_second_drive_alone_has_a_condition(tmp_path):
    demo = Demo(tmp_path / "demo", 1, "straight", 46, {}, "night_lamps")
    assert "condition" not in demo.simulation
    params = in_condition(build(SimParams, demo.simulation | demo.other_day))
    assert params.light.has_street_lamps
    assert params.imaging.noise == 3.0
    assert params.light.clouds == OTHER_DAY["light.clouds"]


def test_a_map_of_another_town_is_refused(tmp_path):
    (tmp_path / "map").mkdir()
    (tmp_path / "teach_logs").mkdir()
    told = {"cycab_sim": {"ros__parameters": SIMULATION | {"seed": 1, "path": "two_turns"} | TEACHING}}
    (tmp_path / "teach_logs" / "cycab_sim.yaml").write_text(yaml.safe_dump(told))
    assert check_taught(tmp_path, SIMULATION | {"seed": 1}) == tmp_path
    with pytest.raises(ValueError, match="seed: expected 2 as in this experiment, found 1"):
        check_taught(tmp_path, {"seed": 2, "path": "two_turns"})
