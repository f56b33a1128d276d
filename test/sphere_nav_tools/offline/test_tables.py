from sphere_nav_tools.offline.tables import columns


def test_cells_stand_below_each_other_words_at_the_left_and_numbers_at_the_right():
    assert columns([("image", 7, ""), ("odometry", 120, "late")]) == ["image       7", "odometry  120  late"]
