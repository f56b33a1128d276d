"""What is drawn for one browser, by what was heard: where the vehicle is, what moves, what is not sent again."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav_tools.cli.operate.page import COLORS, Desk
from sphere_nav_tools.cli.operate.words import Place


class Scene:
    """Keeps what is added to it, as a browser would."""

    def __init__(self):
        self.added = []

    def __getattr__(self, kind):
        def add(name, *words, **values):
            self.added.append((kind.removeprefix("add_"), name, values))
            return SimpleNamespace(position=None, wxyz=None, on_click=lambda act: self.added.append(("click", act, {})))

        return add


@pytest.fixture
def desk():
    desk = Desk.__new__(Desk)
    camera = SimpleNamespace(position=(-3.0, 0.0, 25.0), look_at=(0.0, 0.0, 0.0))
    desk.client = SimpleNamespace(scene=Scene(), camera=camera, atomic=nullcontext)
    desk._drawn, desk._places, desk._middle = {}, [], np.zeros(3)
    desk._follows, desk._place = SimpleNamespace(value=True), SimpleNamespace(options=(), value="")
    return desk


def test_the_vehicle_stands_before_its_rear_axle_and_heads_as_it_does(desk):
    covariance = np.diag([0.09, 0.01])
    desk._show_car((5.0, 3.0, np.pi / 2, covariance), 0.2)
    assert desk._car.position == pytest.approx((5.0, 3.6, 0.3))
    assert desk._car.wxyz == pytest.approx((np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    (box, _, values), (lines, _, outline) = desk.client.scene.added
    assert (box, values["dimensions"], values["color"]) == ("box", (1.9, 1.2, 0.6), COLORS["car"])
    assert (lines, outline["colors"]) == ("line_segments", COLORS["car"])
    low, high = outline["points"].min(axis=(0, 1)), outline["points"].max(axis=(0, 1))
    np.testing.assert_allclose(low, [4.4, 2.8, 0.65], atol=0.01)
    np.testing.assert_allclose(high, [5.6, 3.2, 0.65], atol=0.01)
    desk._show_car((6.0, 3.0, 0.0, covariance), 0.9)
    assert [kind for kind, *_ in desk.client.scene.added].count("box") == 1  # it moves
    assert desk._car.position == pytest.approx((6.6, 3.0, 0.3))
    desk._show_car((6.0, 3.0, 0.0, covariance), 1.1)
    boxes = [values["color"] for kind, _, values in desk.client.scene.added if kind == "box"]
    assert boxes == [COLORS["car"], COLORS["old"]]
    desk._show_car(None, np.inf)
    assert len([kind for kind, *_ in desk.client.scene.added if kind == "box"]) == 2


def test_the_map_moves_by_half_metres_where_it_is_to_follow(desk):
    for x, y, middle in ((0.3, -0.3, (0.0, 0.0)), (0.4, -0.4, (0.4, -0.4)), (0.7, -0.4, (0.4, -0.4))):
        desk._move_map(x, y)
        assert desk._middle[:2].tolist() == list(middle)
    assert desk.client.camera.position.tolist() == pytest.approx([-2.6, -0.4, 25.0])
    assert desk.client.camera.look_at.tolist() == pytest.approx([0.4, -0.4, 0.0])
    desk._follows.value = False
    desk._move_map(9.0, 9.0)
    assert desk._middle[:2].tolist() == [0.4, -0.4]


def test_places_are_balls_that_choose_them(desk):
    places = [Place("gate", 1.0, 2.0), Place("barn", 3.0, 4.0)]
    desk._show_places(places)
    desk._show_places(list(places))
    balls = [values["position"] for kind, _, values in desk.client.scene.added if kind == "icosphere"]
    assert balls == [(1.0, 2.0, 0.0), (3.0, 4.0, 0.0)]
    assert desk._place.options == ("gate", "barn")
    clicks = [act for kind, act, _ in desk.client.scene.added if kind == "click"]
    clicks[1](None)
    assert desk._place.value == "barn"
    desk._show_places([])
    assert desk._place.options == ("(no places heard)",)


def test_pictures_are_made_smaller_and_never_larger(desk):
    desk._pictures = {"image": SimpleNamespace(image=None), "residual": SimpleNamespace(image=None)}
    pictures = {"image": np.full((480, 640), 200, np.uint8), "residual": np.full((60, 80), 90, np.uint8)}
    desk.link = SimpleNamespace(picture=pictures.get)
    desk._show_pictures()
    assert desk._pictures["image"].image.shape[:2] == (240, 320)
    assert desk._pictures["residual"].image.shape[:2] == (60, 80)
