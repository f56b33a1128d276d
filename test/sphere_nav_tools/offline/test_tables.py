import json

from sphere_nav_tools.offline.tables import columns, write_json


def test_cells_stand_below_each_other_words_at_the_left_and_numbers_at_the_right():
    assert columns([("image", 7, ""), ("odometry", 120, "late")]) == ["image       7", "odometry  120  late"]


def test_a_file_of_values_is_read_as_it_was_written(tmp_path):
    write_json(tmp_path / "values.json", {"pose": [1.0, None]})
    assert json.loads((tmp_path / "values.json").read_text()) == {"pose": [1.0, None]}
