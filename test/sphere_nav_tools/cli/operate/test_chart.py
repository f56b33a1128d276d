"""The map of one browser: the vehicle, a view that follows, the way ahead, clicks on the ground."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav_tools.cli.operate.chart import COLORS, Chart, ground_point, way_ahead


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
def chart():
    camera = SimpleNamespace(position=(0.0, 0.0, 0.0), look_at=(0.0, 0.0, 0.0))
    return Chart(SimpleNamespace(scene=Scene(), camera=camera, atomic=nullcontext))


def test_a_vehicle_is_drawn_before_its_rear_axle_and_as_it_heads(chart):
    covariance = np.diag([0.09, 0.01])
    chart._show_car((5.0, 3.0, np.pi / 2, covariance), 0.2)
    assert chart._car.position == pytest.approx((5.0, 3.0, 0.0))
    assert chart._car.wxyz == pytest.approx((np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    (body,) = (values for kind, _, values in chart.client.scene.added if kind == "box")
    assert (body["dimensions"], body["color"]) == ((1.9, 1.2, 0.6), COLORS["car"])
    assert body["position"] == pytest.approx((0.6, 0.0, 0.3))
    (outline,) = (values for _, name, values in chart.client.scene.added if name == "/covariance")
    low, high = outline["points"].min(axis=(0, 1)), outline["points"].max(axis=(0, 1))
    np.testing.assert_allclose(low, [-0.6, -0.2, 0.65], atol=0.01)
    np.testing.assert_allclose(high, [0.6, 0.2, 0.65], atol=0.01)
    chart._show_car((6.0, 3.0, 0.0, covariance), 0.9)
    assert [kind for kind, *_ in chart.client.scene.added].count("box") == 1  # it moves
    assert chart._car.position == chart._doubt.position == pytest.approx((6.0, 3.0, 0.0))
    chart._show_car((6.0, 3.0, 0.0, covariance), 1.1)
    boxes = [values["color"] for kind, _, values in chart.client.scene.added if kind == "box"]
    assert boxes == [COLORS["car"], COLORS["old"]]
    chart._show_car(None, np.inf)
    assert len([kind for kind, *_ in chart.client.scene.added if kind == "box"]) == 2


def test_a_view_glides_after_the_vehicle_and_never_jumps(chart):
    chart.client.camera.position, chart.client.camera.look_at = (0.0, -0.02, 25.0), (0.0, 0.0, 0.0)
    chart._goal = np.array([2.9, 0.0])
    chart.glide()
    assert chart.client.camera.look_at == (0.0, 0.0, 0.0)  # still in the middle
    chart._goal, steps = np.array([30.0, 0.0]), []
    for _ in range(200):
        before = chart.client.camera.look_at[0]
        chart.glide()
        steps.append(chart.client.camera.look_at[0] - before)
    assert 0.0 <= min(steps) <= max(steps) < 2.4
    assert chart.client.camera.look_at[0] == pytest.approx(27.0, abs=0.1)
    np.testing.assert_allclose(np.subtract(chart.client.camera.position, chart.client.camera.look_at), (0, -0.02, 25))
    chart.follows, chart._goal = False, np.zeros(2)
    chart.glide()
    assert chart.client.camera.look_at[0] == pytest.approx(27.0, abs=0.1)


def test_the_way_ahead_begins_where_the_vehicle_is():
    path = np.column_stack([np.arange(11.0), np.zeros(11)])
    assert way_ahead(path, SimpleNamespace(progress=4.0))[0].tolist() == [4.0, 0.0]
    assert len(way_ahead(path, SimpleNamespace(progress=99.0))) == 2
    assert way_ahead(None, SimpleNamespace(progress=4.0)) is None


def test_a_click_is_where_its_ray_meets_the_ground():
    assert ground_point((1.0, 2.0, 10.0), (0.3, 0.0, -1.0)).tolist() == pytest.approx([4.0, 2.0])
    assert ground_point((1.0, 2.0, 10.0), (0.3, 0.0, 0.1)) is None
