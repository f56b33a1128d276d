"""Lenses of other programs: theirs by our names, or refused with the place in the file."""

import pytest

from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.files.foreign_cameras import camera_at, image_size, refuse_model


def test_a_lens_is_ours_or_refused_where_it_stands():
    camera = camera_at("x.yaml.cam0", (640, 480), (500.0, 501.0, 320.0, 240.0), Pinhole)
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (640, 480, 500, 501, 320, 240)
    for plane, found in [((500.0, 501.0, 9000.0, 240.0), "9000"), ((-1.0, 501.0, 320.0, 240.0), "-1")]:
        with pytest.raises(ValueError, match=rf"x\.yaml\.cam0.*{found}"):
            camera_at("x.yaml.cam0", (640, 480), plane, Pinhole)


@pytest.mark.parametrize("wrong", [None, [640], [640, 480, 3], {"width": 640}, [0, 480], [640, "480"]])
def test_a_size_is_two_numbers(wrong):
    assert image_size([640, 480], "x.yaml.cam0.resolution") == (640, 480)
    with pytest.raises(ValueError, match=r"x\.yaml\.cam0\.resolution: expected"):
        image_size(wrong, "x.yaml.cam0.resolution")


def test_a_model_that_we_have_not_is_named():
    assert str(refuse_model("eucm", "x.yaml.cam0.camera_model", "pinhole, ds")) == (
        "x.yaml.cam0.camera_model: expected pinhole, ds, found 'eucm', which is not supported"
    )
