import math
from pathlib import Path

import pytest
import yaml

from cycab_sim.params import CameraParams, SimParams, focal_length
from typed_params import build, to_mapping

CYCAB = Path(__file__).resolve().parents[2] / "config" / "cycab.yaml"


def test_the_measured_car_is_the_simulated_one():
    tree = yaml.safe_load(CYCAB.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    measured = {f"{group}.{name}": value for group, values in tree.items() for name, value in values.items()}
    assert {"vehicle.wheelbase", "actuation.steering_lag"} <= set(measured)
    assert build(SimParams, measured) == SimParams()
    assert to_mapping(SimParams()).items() >= measured.items()


def test_focal_length_from_the_field_of_view():
    assert focal_length(CameraParams(width=640, view_deg=90.0)) == pytest.approx(320.0)
    assert focal_length(CameraParams(width=640, view_deg=80.0)) == pytest.approx(320.0 / math.tan(math.radians(40.0)))
