"""The form of result.json."""

import json

import numpy as np
import pytest

from sphere_nav_tools.cli.experiment.result import JudgedFigure, write_result


@pytest.mark.parametrize(
    ("value", "bound", "is_minimum", "is_met"),
    [(0.03, 0.03, False, True), (0.031, 0.03, False, False), (0.5, 0.5, True, True), (0.49, 0.5, True, False),
     (np.nan, 0.5, False, False), (np.nan, 0.5, True, False), (7.0, None, False, True)],
)  # fmt: skip
def test_a_figure_keeps_its_bound_or_not(value, bound, is_minimum, is_met):
    assert JudgedFigure("error", value, "m", bound, is_minimum).is_met is is_met


def test_a_result_is_passed_with_all_its_bounds_only(tmp_path, capsys):
    good, bad = JudgedFigure("error", 0.02, "m", 0.03), JudgedFigure("gap", 0.4, "m", 0.5, is_minimum=True)
    assert write_result(tmp_path, "walk", 7, [good], {"end": "there"})
    assert not write_result(tmp_path, "walk", 7, [good, bad])
    found = json.loads((tmp_path / "result.json").read_text())
    assert found == {
        "experiment": "walk",
        "seed": 7,
        "has_passed": False,
        "figures": [
            {"name": "error", "value": 0.02, "unit": "m", "bound": 0.03, "is_minimum": False, "is_met": True},
            {"name": "gap", "value": 0.4, "unit": "m", "bound": 0.5, "is_minimum": True, "is_met": False},
        ],
    }
    assert not write_result(tmp_path, "walk", 7, [JudgedFigure("zero", np.inf, "s", 0.5)])
    assert json.loads((tmp_path / "result.json").read_text())["figures"][0]["value"] is None
    out = capsys.readouterr().out
    assert "gap" in out
    assert out.count(" RED") == 2
    assert "every bound is kept" in out
