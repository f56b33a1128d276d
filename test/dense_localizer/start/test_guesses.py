from dense_localizer.start.guesses import Guess, is_same_pose, select_best, select_distinct
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import KeySphere
from worlds.localizer import at

NODE = KeySphere(0, 1, SE3.identity())


def test_the_best_come_first_and_of_one_place_only_the_first_is_kept():
    guesses = [Guess(NODE, at(float(k)), score) for k, score in enumerate((0.2, 0.5, 0.5, 0.9))]
    assert [guess.T_map_camera.translation[0] for guess in select_best(guesses, 3)] == [3.0, 1.0, 2.0]
    guesses = [Guess(NODE, at(x)) for x in (0.0, 0.2, 1.0, 1.1, 5.0)]
    assert [guess.T_map_camera.translation[0] for guess in select_distinct(guesses, 2)] == [0.0, 1.0]
    for x, yaw, is_same in [(0.29, 0.17, True), (0.31, 0.0, False), (0.0, 0.18, False)]:
        assert is_same_pose(at(0.0), at(x, 0.0, yaw)) == is_same
