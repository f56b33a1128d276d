from pathlib import Path

import yaml

from cycab_sim.params import SimParams
from sphere_nav.params import build, to_mapping

CYCAB = Path(__file__).resolve().parents[2] / "config" / "cycab.yaml"


def test_the_measured_car_is_the_simulated_one():
    tree = yaml.safe_load(CYCAB.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    measured = {f"{group}.{name}": value for group, values in tree.items() for name, value in values.items()}
    assert {"vehicle.wheelbase", "actuation.steering_lag"} <= set(measured)
    assert build(SimParams, measured) == SimParams()
    assert to_mapping(SimParams()).items() >= measured.items()
