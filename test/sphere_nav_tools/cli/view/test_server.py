"""The page in a browser without a window: its picture is the renderer's, keys and flights move the camera."""

import numpy as np
import pytest

pytest.importorskip("viser", reason="optional: pip install viser")

from sphere_nav.geometry import Pinhole
from sphere_nav_tools.cli.view.server import drawn_lens


def test_a_camera_is_drawn_as_wide_as_it_sees():
    camera = Pinhole(64, 48, 24.0, 24.0, 31.5, 23.5)
    assert drawn_lens(camera) == pytest.approx({"fov": np.pi / 2, "aspect": 4 / 3})
