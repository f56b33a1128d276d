"""OCamCalib's calib_results.txt: rows before columns, z away from the scene."""

import numpy as np
import pytest

from sphere_nav.geometry.files.foreign_rig import read_foreign_cameras
from sphere_nav.geometry.files.ocam_file import read_ocam, unproject

POLYNOMIAL = [-220.0, 0.0, 1.1e-3, -1.2e-6, 3.0e-9]
CENTER, AFFINE = [238.5, 321.5], [1.001, 0.0005, -0.0004]
TEXT = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB).

5 {polynomial}

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam

3 300.0 150.0 10.0

#center: "row" and "column", starting from 0 (C convention)

{centre}

#affine parameters "c", "d", "e"

{affine}

#image size: "height" and "width"

480 640

"""


def write(path, polynomial=POLYNOMIAL):
    words = {"polynomial": polynomial, "centre": CENTER, "affine": AFFINE}
    path.write_text(TEXT.format(**{name: " ".join(map(str, values)) for name, values in words.items()}))
    return path


def test_axes_are_optical():
    rays = unproject(
        np.array([[321.5, 238.5], [421.5, 238.5], [321.5, 338.5]]), np.array(POLYNOMIAL), CENTER, [1, 0, 0]
    )
    np.testing.assert_allclose(rays[0], [0.0, 0.0, 220.0])
    assert rays[1, 0] > 0
    assert rays[1, 1] == 0
    assert rays[2, 1] > 0
    assert rays[2, 0] == 0


def test_the_camera_stands_in_for_the_polynomial(tmp_path):
    found = read_foreign_cameras([write(tmp_path / "calib_results.txt")])
    (camera,), (fit,) = found.cameras, found.fits
    pixels = np.array([[320.0, 240.0], [100.0, 100.0], [500.0, 300.0]])
    rays = unproject(pixels, np.array(POLYNOMIAL), CENTER, AFFINE)
    np.testing.assert_allclose(camera.project(rays)[0], pixels, atol=fit.max_px)
    assert (camera.width, camera.height) == (640, 480)
    assert 0 < fit.rms_px < 0.3


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda text: text.replace("5 -220.0", "6 -220.0"), "polynomial: expected 6 coefficients, found 5"),
        (lambda text: text.replace("-220.0", "x"), "expected a finite number, found 'x'"),
        (lambda text: text.replace("480 640", ""), "centre, c d e and size, found 4 lines"),
        (lambda text: text.replace("-220.0", "220.0"), "expected rays ahead of the camera"),
    ],
)
def test_a_defect_is_one_line(tmp_path, change, expected):
    path = write(tmp_path / "calib_results.txt")
    path.write_text(change(path.read_text()))
    with pytest.raises(ValueError, match=r"calib_results\.txt: ") as caught:
        read_ocam(path)
    assert expected in str(caught.value)
