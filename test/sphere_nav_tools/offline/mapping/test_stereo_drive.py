"""A drive says what is off in its stereo pair before it is mapped; a right pair is left alone."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.stereo_field import StereoField
from sphere_mapping.acquisition.stereo.track_fit import ColumnFit
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.ros.bags import BagReader
from sphere_nav_tools.offline.mapping import stereo_drive
from sphere_nav_tools.offline.mapping.stereo_drive import find_field
from worlds.recordings import stereo, write_bag

# Written out: imported, a change would go unseen.


@pytest.mark.slow
def test_a_right_pair_is_left_alone(tmp_path):
    write_bag(tmp_path / "bag", stereo, numbers=range(5))
    with BagReader(tmp_path / "bag") as bag:
        pair, words = find_field(bag, {"input": "stereo"}, {name: f"/{name}" for name in TOPICS["stereo"]})
    assert not any(pair.correction.columns)
    assert words.startswith("stereo: rows off by 0.")
    assert words.endswith("disparity as told")


@pytest.mark.parametrize(
    ("columns", "words"), [(None, "as told"), ([2.5, 1.0], "too small"), ([0.01, 0.02], "as told")]
)
def test_a_disparity_is_corrected_only_where_chance_would_hardly_give_its_error(tmp_path, monkeypatch, columns, words):
    write_bag(tmp_path / "bag", stereo, numbers=range(2))
    fit = None if columns is None else ColumnFit(np.array(columns), np.diag([0.01, 0.04]), 300)
    monkeypatch.setattr(stereo_drive, "fit_columns", lambda camera, baseline_m, windows: fit)
    with BagReader(tmp_path / "bag") as bag:
        pair, found = find_field(bag, {"input": "stereo"}, {name: f"/{name}" for name in TOPICS["stereo"]})
    assert words in found
    assert tuple(pair.correction.columns) == (tuple(columns) if words == "too small" else StereoField().columns)
