"""`sphere_nav map-forget`: a new map from what drives have rejected; the old one stays."""

import json

import numpy as np
import pytest

pytest.importorskip("rclpy")

from dense_localizer.constants import SQUARE_COLUMNS, SQUARE_ROWS
from sphere_nav.geometry import SE3
from sphere_nav.ros.maps.reader import open_map, save_map
from sphere_nav_tools.cli.main import main
from worlds.localizer import make_map
from worlds.room import wide_room


@pytest.fixture
def map_path(tmp_path):
    return save_map(tmp_path / "map", make_map(wide_room(), [SE3.identity(), SE3.from_planar(1.0, 0.0, 0.0)]).graph)


def write(path, map_id, *rejected):
    count = np.zeros((2, SQUARE_ROWS, SQUARE_COLUMNS), np.int64)
    count[0] += 5
    for row, column in rejected:
        count[:, row, column] = 5
    path.write_text(json.dumps({"map_id": map_id, "spheres": {"0": count.tolist()}}))
    return str(path)


def test_squares_that_drives_reject_together_lose_their_range(map_path, tmp_path, capsys):
    with open_map(map_path) as reader:
        map_id, before = str(reader.info.map_id), reader.load_sphere(0)
    files = [write(tmp_path / f"{day}.json", map_id, (16, 32), (4, 5)) for day in ("a", "b")]
    assert main(["map-forget", str(map_path), files[0], "-o", str(tmp_path / "none")]) == 1  # five times are too few
    assert main(["map-forget", str(map_path), *files, "-o", str(tmp_path / "new")]) == 0
    assert "1 key spheres" in capsys.readouterr().out
    with open_map(tmp_path / "new") as reader:
        after, other = reader.load_sphere(0), reader.load_sphere(1)
    is_lost = np.isnan(after.range_m) & ~np.isnan(before.range_m)
    assert np.count_nonzero(is_lost) == 2 * (512 // SQUARE_COLUMNS) * (256 // SQUARE_ROWS)
    assert np.all(is_lost[16 * 8 : 17 * 8, 32 * 8 : 33 * 8])
    assert not np.isnan(other.range_m).any()
    with open_map(map_path) as reader:
        np.testing.assert_array_equal(reader.load_sphere(0).range_m, before.range_m)


def test_another_maps_rejections_and_a_map_in_the_place_are_refused(map_path, tmp_path, capsys):
    file = write(tmp_path / "a.json", "another", (1, 1))
    assert main(["map-forget", str(map_path), file, "-o", str(tmp_path / "new")]) == 2
    assert "map_id: expected" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
