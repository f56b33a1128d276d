"""`sphere_nav view`: a picture without a browser, and what a browser is shown."""

from argparse import ArgumentError, ArgumentParser
from types import SimpleNamespace
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli import gate, view
from sphere_nav_tools.cli.gate import Address
from sphere_nav_tools.cli.main import main
from worlds.localizer import make_map
from worlds.room import Room, optical


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    save_map(folder / "map", make_map(Room(), [SE3.from_planar(x, 0.0, 0.0) for x in (-1.0, 0.0, 1.0)]).graph)
    return folder


def test_a_screenshot_is_what_a_camera_sees_there(folder, tmp_path, capsys):
    output = tmp_path / "view.png"
    words = ["view", str(folder / "map"), "--screenshot", str(output), "--size", "160x120"]
    assert main([*words, "--pose", "0.3,0.2,0.1,30,5"]) == 0
    assert "seen" in capsys.readouterr().out
    focal = 0.65 * 160
    turn = SE3.exp([0, 0, 0, 0, 0, np.radians(30)]) @ SE3.exp([0, 0, 0, 0, np.radians(5), 0])
    T = optical(SE3.from_parts(np.eye(3), [0.3, 0.2, 0.1]) @ turn)
    gray, _ = Room().render(Pinhole(160, 120, focal, focal, 79.5, 59.5), T)
    assert np.median(np.abs(cv2.imread(str(output), cv2.IMREAD_GRAYSCALE) - gray)) < 6
    assert main([*words, "--sphere", "1"]) == 2  # nothing is overwritten
    assert "expected no such file" in capsys.readouterr().err


T = SE3.exp([1.0, -2.0, 3.0, 0.3, -0.4, 0.5])


@pytest.mark.parametrize(("aspect", "width", "height"), [(1.6, 800, 500), (1.0, 800, 800), (0.5, 400, 800)])
def test_a_browser_sees_no_more_pixels_than_are_drawn(aspect, width, height):
    camera = view.browser_camera(SimpleNamespace(aspect=aspect, fov=np.pi / 3))  # of the height
    focal = pytest.approx(height / 2 * np.sqrt(3))
    assert (camera.width, camera.height, camera.fx, camera.fy) == (width, height, focal, focal)
    assert (camera.cx, camera.cy) == (0.5 * (width - 1), 0.5 * (height - 1))


def test_a_browser_looks_where_its_camera_looks():
    x, y, z, w = T.quaternion
    found = gate.browser_pose(SimpleNamespace(wxyz=(w, x, y, z), position=T.translation))
    np.testing.assert_allclose(found.matrix, T.matrix, atol=1e-12)
    np.testing.assert_allclose(view.look_at(T), T.apply(np.array([[0.0, 0.0, 1.0]]))[0])  # a metre ahead


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
    np.testing.assert_allclose(begin((1, 2, 3, 40, -20, 10)).matrix, expected.matrix, atol=1e-12)
    parser = ArgumentParser(exit_on_error=False)
    view.add_arguments(parser)
    with pytest.raises(ArgumentError, match="--sphere: not allowed with argument --pose"):
        parser.parse_args(["map", "--pose", "1,2,3,4", "--sphere", "7"])


PLACES = [SE3.from_planar(x, y, 0.0) for x, y in ((0, 0), (20, 0), (20, 20))]


@pytest.fixture
def page(monkeypatch):
    """A page without a server: three key spheres on a way, and a loop between the first and the last one."""
    monkeypatch.setattr(gate, "make_server", lambda *_: MagicMock())
    edges = [Edge(0, 1, SE3.identity(), np.eye(6)), Edge(0, 2, SE3.identity(), np.eye(6), is_loop=True)]
    graph = SphereGraph([KeySphere(i, i, T) for i, T in enumerate(PLACES)], edges)
    scene = MagicMock(experiences=[Experience("", "night", "b", 5)])
    return view.Page(Address("view", "", 0, ""), graph, scene, PLACES[1] @ T_BODY_OPTICAL)


def browser(T):
    x, y, z, w = T.quaternion
    camera = SimpleNamespace(wxyz=(w, x, y, z), position=T.translation, aspect=2.0, fov=1.0, on_update=MagicMock())
    return MagicMock(camera=camera)


def test_a_page_shows_the_graph_and_goes_to_the_key_sphere_that_is_clicked(page):
    scene, client = page.server.scene, browser(PLACES[0] @ T_BODY_OPTICAL)
    lines = {call.args[0]: call.kwargs["points"] for call in scene.add_line_segments.call_args_list}
    np.testing.assert_allclose(lines["/graph/way"], [[[0, 0, -0.4], [20, 0, -0.4]]])
    np.testing.assert_allclose(lines["/graph/loops"], [[[0, 0, -0.4], [20, 20, -0.4]]])
    dots = [call.kwargs["position"] for call in scene.add_icosphere.call_args_list]
    np.testing.assert_allclose(dots, [T.translation - [0, 0, 0.4] for T in PLACES])  # who stands there sees past them
    np.testing.assert_allclose(page.server.initial_camera.look_at, [21.0, 0.0, 0.0])
    handle = scene.add_icosphere.return_value
    handle.on_click.call_args_list[2].args[0](SimpleNamespace(client=client))
    np.testing.assert_allclose(client.camera.position, [20.0, 20.0, 0.0])
    np.testing.assert_allclose(client.camera.look_at, [21.0, 20.0, 0.0], atol=1e-9)


def test_a_browser_is_sent_small_views_while_it_moves_and_large_ones_once_it_stands(page, monkeypatch):
    threads, client = [], browser(T)
    monkeypatch.setattr(view.threading, "Thread", lambda target, args, daemon: threads.append(args) or MagicMock())
    page._welcome(client)
    client.gui.add_dropdown.return_value.value = view.ANY_LOOK
    ((_, _, draw),) = threads
    render, is_ready = page._scene.render, page._scene.is_ready
    render.return_value = SimpleNamespace(image=np.full((2, 2, 3), 9, np.uint8), is_known=np.eye(2, dtype=bool))
    for is_still, count, width in ((False, 2, 480), (True, 4, 800)):
        is_ready.return_value = is_still
        assert draw(is_still) == is_still
        (_, lens, look), options = render.call_args
        assert (lens.width, lens.height, look, options["count"]) == (width, width // 2, None, count)
    picture = client.scene.set_background_image.call_args.args[0]
    assert (picture[:, :, 0] == [[9, 60], [60, 9]]).all()  # holes are dark
    assert "50 % seen" in client.gui.add_markdown.return_value.content
    assert not client.gui.add_dropdown.return_value.visible  # of two looks one is all
    page._scene.experiences.append(Experience("", "dusk", "c", 5))
    page._welcome(client)
    assert client.gui.add_dropdown.return_value.visible
