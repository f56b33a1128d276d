"""Lenses of other programs: theirs by our names, or refused with the place in the file."""

import pytest

from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.files.foreign_cameras import camera_at, refuse_model


def test_a_lens_is_ours_or_refused_where_it_stands():
    camera = camera_at("x.yaml.cam0", (640, 480), (500.0, 501.0, 320.0, 240.0), Pinhole)
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (640, 480, 500, 501, 320, 240)
    for plane, found in [((500.0, 501.0, 9000.0, 240.0), "9000"), ((-1.0, 501.0, 320.0, 240.0), "-1")]:
        with pytest.raises(ValueError, match=rf"x\.yaml\.cam0.*{found}"):
            camera_at("x.yaml.cam0", (640, 480), plane, Pinhole)


def test_a_model_that_we_have_not_is_named():
    assert str(refuse_model("eucm", "x.yaml.cam0.camera_model", "pinhole, ds")) == (
        "x.yaml.cam0.camera_model: expected pinhole, ds, found 'eucm', which is not supported"
    )
