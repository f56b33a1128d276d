from contextlib import nullcontext
from pathlib import Path

import pytest
import yaml

from cycab_sim.params import CONDITIONS, LightParams, SimParams, in_condition, split_numbers
from sphere_nav.params import build, to_mapping

CYCAB = Path(__file__).resolve().parents[2] / "config" / "cycab.yaml"


def test_the_measured_car_is_the_simulated_one():
    tree = yaml.safe_load(CYCAB.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    measured = {f"{group}.{name}": value for group, values in tree.items() for name, value in values.items()}
    assert {"vehicle.wheelbase", "actuation.steering_lag"} <= set(measured)
    assert build(SimParams, measured) == SimParams()
    assert to_mapping(SimParams()).items() >= measured.items()


def test_a_condition_sets_what_is_not_set():
    for name in CONDITIONS:
        assert to_mapping(in_condition(SimParams(condition=name))).items() >= CONDITIONS[name].items()
        own = in_condition(build(SimParams, {"condition": name, "light.exposure": 1.23}))
        assert own.light.exposure == 1.23
        assert in_condition(own) == own


def test_numbers_of_a_parameter_keep_each_to_its_own_bounds_and_others_are_refused_by_name():
    for text, is_taken in [("1,-2", True), ("4.1,0", False), ("2,-3.1", False), ("a,2", False)]:
        refusal = pytest.raises(ValueError, match=f"^it: expected a,b within 0,-3 to 4,5, found '{text}'$")
        with nullcontext() if is_taken else refusal:
            assert split_numbers("it", text, "a,b", (0, -3), (4, 5)) == tuple(map(float, text.split(",")))
    with pytest.raises(ValueError, match=r"light\.sun: expected azimuth,elevation within .* found '0,2\.9'"):
        _ = LightParams(sun="0,2.9").sun_deg
