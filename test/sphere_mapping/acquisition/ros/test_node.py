"""The node sphere_stitcher without a usable rig; with one: test/nodes/test_sphere_stitcher.py."""

import pytest

pytest.importorskip("rclpy")

from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_nav.ros.bags.replay import OfflineBus


def test_a_rig_file_that_is_none_is_named(tmp_path):
    (tmp_path / "rig.yaml").write_text("nothing: 1\n")
    with pytest.raises(ValueError, match=r"rig\.yaml"):
        OfflineBus().add(SphereStitcher, {"rig": str(tmp_path / "rig.yaml")})
