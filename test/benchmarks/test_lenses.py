"""What is judged of the drives by other lenses; their rows are the commands."""

import numpy as np

from benchmarks.drive.lenses import ROWS, cells, judge
from benchmarks.drive.repeats import Found


def test_a_pose_counts_by_what_it_was_told_to_be_off():
    row = next(one for one in ROWS if one.name == "first night, pose given")
    off = np.zeros((4, 6))
    off[0, :3] = 0.06, 0.0, 0.08
    found = Found(5, 0.8, 0.2, "1 LOST", off, np.array([9.0, 4.5, 4.4, 0.0]))
    bounds = judge(row, found, "")
    assert [bound.measured for bound in bounds] == [0.8, 0.2, 0.5, 0.0]
    assert [bound.is_met for bound in bounds] == [False, True, False, True]
    assert cells(row, found)[-4:] == ("50.0 mm", "100 mm", "50.0%", "1 LOST")


def test_a_wrong_lens_is_met_by_what_names_or_withholds_the_pose_and_a_right_one_by_what_does_not_name_it():
    wrong = next(one for one in ROWS if one.longer)
    told, trusted = (Found(5, share, 0.2, "4 DEGRADED BAD_INFO", np.zeros((1, 6)), np.zeros(1)) for share in (0.2, 0.4))
    assert [judge(wrong, found, "")[0].is_met for found in (told, trusted)] == [True, False]
    assert not judge(ROWS[0], told, "")[-1].is_met
