"""The page in a browser without a window: its picture is the renderer's, keys and flights move the camera."""

import time

import cv2
import numpy as np
import pytest

pytest.importorskip("viser", reason="optional: pip install viser")

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.localization.status import State, Status
from sphere_nav.spheres.graph import Edge, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav_tools.cli.gate import link_to
from sphere_nav_tools.cli.view.drive import Shot
from sphere_nav_tools.cli.view.server import Page, browser_camera, browser_pose, drawn_lens
from worlds.browser import Browser, find_browser
from worlds.localizer import make_map
from worlds.room import Room

PLACES = [SE3.from_planar(x, 0.0, 0.0) for x in (-1.0, 0.0, 1.0)]
CENTER = slice(200, 500), slice(50, 550)  # rows and columns of the window that no panel covers
TOKEN = "a token of the room"
WAIT_S = 120.0


def wait_for(condition):
    end = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end, f"waited {WAIT_S:g} s in vain"
        time.sleep(0.2)


class Fixture:
    """A page of a small map, and a browser that shows it."""

    def __init__(self, program):
        nodes = make_map(Room(), PLACES, Spherical(512, 256))
        edges = [Edge(i, i + 1, SE3.from_planar(1.0, 0.0, 0.0), np.eye(6)) for i in range(2)]
        self.graph = SphereGraph(nodes.graph, edges)
        self.scene = Scene(nodes)
        self.page = Page(self.graph, self.scene, PLACES[0] @ T_BODY_OPTICAL, host="127.0.0.1", port=8950, token=TOKEN)
        self.browser = Browser(program)
        self.browser.call("Page.navigate", url=link_to("127.0.0.1", self.page.port, TOKEN))
        wait_for(lambda: self.page.server.get_clients())
        self.client = next(iter(self.page.server.get_clients().values()))

    def difference(self):
        """Return the median difference of page and renderer in grey levels, for what no panel covers."""
        seen = self.browser.screenshot()
        view = self.scene.render(browser_pose(self.client.camera), browser_camera(self.client.camera))
        height, width = seen.shape[:2]
        expected = cv2.resize(view.image, (width, height), interpolation=cv2.INTER_LINEAR)
        return float(np.median(np.abs(seen[CENTER].astype(float) - expected[CENTER])))

    def position(self):
        return np.array(self.client.camera.position)

    def close(self):
        self.browser.close()
        self.page.close()
        self.scene.close()


def test_a_camera_is_drawn_as_wide_as_it_sees():
    camera = Pinhole(64, 48, 24.0, 24.0, 31.5, 23.5)
    assert drawn_lens(camera) == pytest.approx({"fov": np.pi / 2, "aspect": 4 / 3})


@pytest.fixture(scope="module")
def shown():
    program = find_browser()
    if program is None:
        pytest.skip("no chromium here")
    fixture = Fixture(program)
    yield fixture
    fixture.close()


@pytest.mark.dds
def test_the_page_shows_what_the_renderer_draws(shown):
    # JPEG and enlarging change a pixel by a few grey levels; another place or a turned picture by 20 and more
    wait_for(lambda: shown.difference() < 6.0)
    other = shown.scene.render(PLACES[2] @ T_BODY_OPTICAL, browser_camera(shown.client.camera)).image
    here = shown.scene.render(browser_pose(shown.client.camera), browser_camera(shown.client.camera)).image
    assert np.median(np.abs(other.astype(float) - here)) > 12.0


@pytest.mark.slow
def test_a_key_moves_the_camera_and_the_picture_follows(shown):
    before = shown.position()
    shown.browser.hold_key("w", 0.7)
    wait_for(lambda: np.linalg.norm(shown.position() - before) > 0.02)
    assert (shown.position() - before)[0] > 0  # ahead
    wait_for(lambda: shown.difference() < 6.0)


@pytest.mark.slow
def test_one_flies_to_a_key_sphere(shown):
    target = PLACES[2] @ T_BODY_OPTICAL
    shown.page.fly(shown.client, target)
    wait_for(lambda: np.linalg.norm(shown.position() - target.translation) < 0.01)
    assert browser_pose(shown.client.camera).distance(target)[1] < 0.02
    wait_for(lambda: shown.difference() < 6.0)


@pytest.mark.slow
def test_a_drive_is_shown_with_image_residual_and_status(shown):
    image, residual = np.full((48, 64, 3), 90, np.uint8), np.full((48, 64), 128, np.uint8)
    T = PLACES[1] @ T_BODY_OPTICAL
    shot = Shot(2_500_000_000, image, residual, T, Status(State.TRACKING, quality=0.8))
    shown.page.show(shot, Pinhole(64, 48, 50.0, 50.0, 31.5, 23.5))

    def text():
        found = shown.browser.call("Runtime.evaluate", expression="document.body.innerText")
        return found["result"]["value"]

    wait_for(lambda: "TRACKING" in text())
    assert "2.50 s" in text()
    assert "residual" in text()
