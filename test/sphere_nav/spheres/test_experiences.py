"""Which experiences a map holds, where, and how they serve."""

from sphere_nav.geometry import SE3
from sphere_nav.spheres.experiences import (
    Service,
    count_image,
    find_places,
    split_by_experience,
    with_experience,
    with_service,
)
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph

NIGHT = Experience("night", "rgbd 64 x 48", "drive_2", 7)


def line():
    return SphereGraph([KeySphere(k, k, SE3.from_planar(float(k), 0.0, 0.0), region_radius_m=2.4) for k in range(4)])


def test_key_spheres_are_split_by_experience():
    graph = with_experience(line(), NIGHT, [1, 3])
    parts = split_by_experience(graph)
    assert {one.name: list(part.nodes) for one, part in parts.items()} == {"": [0, 2], "night": [1, 3]}
    assert list(graph.nodes) == [0, 1, 2, 3]
    assert (str(NIGHT), str(Experience(drive="d")), str(Experience())) == ("night", "d", "the first drive")


def test_service_is_a_mean_in_which_later_drives_count_more():
    graph = with_service(line(), {1: Service(8, 100)})
    assert [node.served for node in graph] == [0.0, 8.0, 0.0, 0.0]
    graph = with_service(graph, {1: Service(2, 200), 2: Service(1, 250)})
    assert [node.served for node in graph] == [0.0, 5.0, 1.0, 0.0]
    assert [node.last_served_ns for node in graph] == [0, 200, 250, 0]
    again = with_service(graph, {1: Service(5, 300), 2: Service(1, 300)})  # the same again: the mean stays
    assert [node.served for node in again] == [0.0, 5.0, 1.0, 0.0]
    assert [node.last_served_ns for node in with_service(graph, {})] == [0, 200, 250, 0]


def test_images_are_counted_by_the_key_sphere_that_explains_them():
    served: dict[int, Service] = {}
    for stamp in (100, 200):
        count_image(served, 3, stamp)
    assert served == {3: Service(2.0, 200)}


def test_a_drive_by_night_tells_nothing_of_the_day():
    graph = with_service(with_experience(line(), NIGHT, [1, 3]), {0: Service(8, 1), 1: Service(8, 1), 2: Service(4, 1)})
    by_night = with_service(graph, {1: Service(6, 2), 3: Service(2, 2)})
    assert [node.served for node in by_night] == [8.0, 7.0, 4.0, 2.0]
    in_both = with_service(graph, {1: Service(6, 2), 2: Service(2, 2)})  # a quarter of it by the day's
    assert [node.served for node in in_both] == [8.0 * 0.875, 8.0 * 0.625 + 3.0, 4.0 * 0.875 + 1.0, 0.0]


def test_nobody_has_counted_what_a_first_day_explains():
    """It begins with what the drive's own key spheres explain, and the drive counts as it does for others."""
    first = {2: Service(6, 7), 3: Service(3, 8)}
    graph = with_service(with_experience(line(), NIGHT, [2, 3]), {1: Service(3, 9)}, first)
    share = 3 / 12  # of the drive by the day's
    assert [node.served for node in graph] == [4.5 * (1 - share / 2), 4.5 * (1 - share / 2) + 1.5, 6.0, 3.0]
    assert [node.last_served_ns for node in graph] == [0, 9, 7, 8]
    given = with_service(with_experience(line(), NIGHT, [2, 3]), {}, first, 20.0)
    assert [node.served for node in given] == [20.0, 20.0, 6.0, 3.0]
    known = with_service(with_experience(line(), NIGHT, [3]), {1: Service(8, 100)})
    assert [node.served for node in with_service(known, {}, {3: Service(2, 200)})] == [2.0, 8.0, 2.0, 2.0]


def test_a_place_is_what_is_near_by_the_region():
    graph = with_service(with_experience(line(), NIGHT, [1]), {1: Service(4, 1)})
    places = find_places(graph, is_whole=True)
    assert {one.name: served for one, served in places[0].items()} == {"": 0.0, "night": 4.0}
    assert list(places[3]) == [Experience()]  # 2 m from the night's
