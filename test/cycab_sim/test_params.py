from pathlib import Path

import pytest
import yaml

from cycab_sim.params import CONDITIONS, SimParams, in_condition
from sphere_nav.params import build, to_mapping

CYCAB = Path(__file__).resolve().parents[2] / "config" / "cycab.yaml"


def test_the_measured_car_is_the_simulated_one():
    tree = yaml.safe_load(CYCAB.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    measured = {f"{group}.{name}": value for group, values in tree.items() for name, value in values.items()}
    assert {"vehicle.wheelbase", "actuation.steering_lag"} <= set(measured)
    assert build(SimParams, measured) == SimParams()
    assert to_mapping(SimParams()).items() >= measured.items()


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_condition_sets_what_is_not_set(name):
    assert to_mapping(in_condition(SimParams(condition=name))).items() >= CONDITIONS[name].items()
    own = in_condition(build(SimParams, {"condition": name, "light.exposure": 1.23}))
    assert own.light.exposure == 1.23
    assert in_condition(own) == own


def test_without_a_condition_nothing_is_set():
    assert in_condition(SimParams(seed=3)) == SimParams(seed=3)
