"""The node sphere_stitcher without a usable rig; with one: test/nodes/test_sphere_mapping_stitcher.py."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.range.rectification import RigCorrection
from sphere_mapping.acquisition.ros import node as module
from sphere_mapping.acquisition.ros.node import SphereStitcher, draw_preview
from sphere_mapping.acquisition.ros.rig_intake import RigInstant
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.spheres.sphere import Sphere
from worlds.rig import vertical_rig


@pytest.mark.slow
def test_a_camera_turned_by_more_than_half_a_degree_is_warned_of(tmp_path, monkeypatch):
    write_rig(tmp_path / "rig.yaml", vertical_rig())
    node = OfflineBus().add(SphereStitcher, {"rig": str(tmp_path / "rig.yaml")})
    for angle_deg, level in [(0.49, module.OK), (0.51, module.WARN)]:
        monkeypatch.setattr(module, "rectify", lambda rig, _, a=angle_deg: RigCorrection(rig, {"top_left": a}, 1, 0))
        node.rectify([])
        assert node.reports["rig"][0] == level


def test_an_instant_without_any_image_names_what_lacks(tmp_path):
    write_rig(tmp_path / "rig.yaml", vertical_rig())
    node = OfflineBus().add(SphereStitcher, {"rig": str(tmp_path / "rig.yaml")})
    node.deliver(
        RigInstant(SimpleNamespace(stamp_ns=10**9, notes={"top_left": "late", "top_right": "late"}), {}, {}, None)
    )
    assert node.reports["stitching"][:2] == (module.WARN, "no sphere: top_left, top_right")


@pytest.mark.parametrize(("width", "shown"), [(2048, 1024)])
def test_a_preview_is_a_small_jpeg_in_the_colors_of_the_sphere(width, shown):
    image = np.full((width // 2, width, 3), (200, 100, 30), np.uint8)
    sphere = Sphere(image, np.ones(image.shape[:2], np.float32), Spherical(width, width // 2), 7_000_000_005)
    message = draw_preview(sphere, "there")
    seen = cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_COLOR)
    assert seen.shape == (shown // 2, shown, 3)
    assert np.abs(seen.astype(int) - (30, 100, 200)).max() <= 4  # BGR; what JPEG loses of one colour
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (7, 5, "there")
