"""The parts of the viewer that need no browser: lenses, poses, pictures, the map from above, the words beside them."""

import threading
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.view import server, view
from sphere_nav_tools.cli.view.server import COLORS, SIDE, Minimap

T = SE3.exp([1.0, -2.0, 3.0, 0.3, -0.4, 0.5])


def test_a_browser_sees_no_more_pixels_than_are_drawn():
    for aspect, size in [(1.6, (800, 500)), (1.0, (800, 800)), (0.5, (400, 800))]:
        camera = server.browser_camera(SimpleNamespace(aspect=aspect, fov=np.radians(60.0)))
        focal = 0.5 * size[1] / np.tan(np.radians(30.0))  # the field of view is that of the height
        center = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
        assert ((camera.width, camera.height), (camera.cx, camera.cy)) == (size, center)
        assert (camera.fx, camera.fy) == (pytest.approx(focal), pytest.approx(focal))


def test_a_browser_looks_where_its_camera_looks():
    x, y, z, w = T.quaternion
    found = server.browser_pose(SimpleNamespace(wxyz=(w, x, y, z), position=T.translation))
    np.testing.assert_allclose(found.matrix, T.matrix, atol=1e-12)
    np.testing.assert_allclose(server.look_at(T), T.apply(np.array([[0.0, 0.0, 1.0]]))[0])  # a metre ahead


def test_a_camera_is_told_where_it_is():
    graph = SphereGraph([KeySphere(3, 0, SE3.from_planar(1.0, 2.0, 0.0)), KeySphere(7, 0, SE3.identity())])
    told = server.whereabouts(graph, SE3.from_planar(1.0, 2.5, np.pi / 2) @ T_BODY_OPTICAL)
    assert told == "x 1.0, y 2.5, z 0.0 m, looks 90 deg; 0.5 m from key sphere 3"


def test_a_view_is_small_while_the_camera_moves_and_whole_once_it_stands():
    asked, drawn = [], []
    page = server.Page.__new__(server.Page)
    page._scene = SimpleNamespace(
        is_ready=lambda T, look, count: True,
        render=lambda T, lens, look, is_waiting, count: asked.append((lens.width, count)),
    )
    client = SimpleNamespace(camera=SimpleNamespace(aspect=1.6, fov=1.0), client_id=0)
    for is_still in (False, True):
        page._view(client, T, None, is_still)
    assert asked == [(480, 2), (800, 4)]
    page._closed, changed = threading.Event(), threading.Event()
    page.server = SimpleNamespace(get_clients=lambda: (0,) if len(drawn) < 2 else ())
    changed.set()
    page._follow(client, changed, lambda is_still: drawn.append(is_still) or True)
    assert drawn == [False, True]


def test_holes_are_dark_and_files_keep_their_colors():
    image = np.zeros((4, 6, 3), np.uint8)
    image[..., 0], image[..., 2] = 200, 40
    is_known = np.ones((4, 6), np.bool_)
    is_known[1, 2] = False
    shown = server.shown(SimpleNamespace(image=image, is_known=is_known))
    assert shown[1, 2].tolist() == [60, 60, 60]
    assert shown[0, 0].tolist() == [200, 0, 40]
    assert image[1, 2].tolist() == [200, 0, 40]  # the view itself stays
    decoded = cv2.imdecode(np.frombuffer(server.encoded(shown, ".png"), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(decoded[..., ::-1], shown)
    np.testing.assert_array_equal(server.colored(image[..., 0]), np.full((4, 6, 3), 200))


def test_a_screenshot_has_the_field_of_view_of_its_width():
    for size, fov, focal in [("160x120", 90.0, 80.0), ("100x300", 2 * np.degrees(np.arctan(0.5)), 100.0)]:
        width, height = map(int, size.split("x"))
        found = view.camera_for(size, fov)
        assert (found.width, found.height, found.cx, found.cy) == (width, height, (width - 1) / 2, (height - 1) / 2)
        assert (found.fx, found.fy) == (pytest.approx(focal), pytest.approx(focal))


def test_a_view_begins_at_a_pose_or_a_key_sphere_and_not_at_both():
    graph = SphereGraph([KeySphere(3, 0, T), KeySphere(7, 0, SE3.identity())])
    reader = SimpleNamespace(graph=graph)

    def begin(pose=None, sphere=None):
        return view.first_pose(reader, SimpleNamespace(pose=pose, sphere=sphere)) @ T_BODY_OPTICAL.inverse()

    np.testing.assert_allclose(begin().matrix, T.matrix, atol=1e-12)  # the first one
    np.testing.assert_allclose(begin(sphere=7).matrix, np.eye(4), atol=1e-12)
    turn = SE3.exp([0, 0, 0, 0, 0, np.radians(40)]) @ SE3.exp([0, 0, 0, 0, np.radians(-20), 0])
    turn = turn @ SE3.exp([0, 0, 0, np.radians(10), 0, 0])
    expected = SE3.from_parts(turn.rotation, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(begin("1,2,3,40,-20,10").matrix, expected.matrix, atol=1e-12)
    with pytest.raises(ValueError, match="expected one of them, found both"):
        begin("1,2,3,4", 7)
    for text in ("1,2,3", "1,2,3,4,5,6,7", "1,2,3,inf"):
        with pytest.raises(ValueError, match="--pose: expected x,y,z,yaw"):
            begin(text)


PLACES = [SE3.from_planar(x, y, 0.0) for x, y in ((0, 0), (20, 0), (20, 20))]


def has(picture, color, u, v):
    return (picture[v - 2 : v + 3, u - 2 : u + 3] == color).all(axis=-1).any()


def test_key_spheres_and_loops_lie_where_they_are():
    edges = [Edge(0, 1, SE3.identity(), np.eye(6)), Edge(0, 2, SE3.identity(), np.eye(6), is_loop=True)]
    minimap = Minimap(SphereGraph([KeySphere(i, i, T) for i, T in enumerate(PLACES)], edges))
    picture = minimap.draw(PLACES[1] @ T_BODY_OPTICAL)
    pixels = [minimap.pixel(T) for T in PLACES]
    assert pixels[0][0] < pixels[1][0] == pixels[2][0]
    assert pixels[0][1] == pixels[1][1] > pixels[2][1]
    assert has(picture, COLORS["key"], *pixels[2])
    assert has(picture, COLORS["camera"], *pixels[1])
    assert has(picture, COLORS["camera"], pixels[1][0] + 10, pixels[1][1])  # it looks along x
    assert has(picture, COLORS["loops"], SIDE // 2, SIDE // 2)
