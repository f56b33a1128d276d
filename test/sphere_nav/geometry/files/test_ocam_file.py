"""OCamCalib's calib_results.txt: rows before columns, z away from the scene."""

import numpy as np

from sphere_nav.geometry.files.foreign_rig import read_foreign_cameras
from sphere_nav.geometry.files.ocam_file import read_ocam
from worlds.foreign import refusal

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


def rays_of(pixels):
    """OCamCalib's cam2world (N, 3), with optical axes: its x along rows, y along columns, z from the scene."""
    c, d, e = AFFINE
    offset = np.linalg.inv([[c, d], [e, 1.0]]) @ (pixels[:, ::-1] - CENTER).T
    z = np.polyval(POLYNOMIAL[::-1], np.linalg.norm(offset, axis=0))
    return np.stack([offset[1], offset[0], -z], axis=1)


def test_the_camera_is_the_polynomial_with_its_affine_part(tmp_path):
    (camera,) = read_foreign_cameras([write(tmp_path / "calib_results.txt")]).cameras
    pixels = np.array([[320.0, 240.0], [100.0, 100.0], [500.0, 300.0], [630.0, 470.0], [321.5, 100.0]])
    rays = rays_of(pixels)
    np.testing.assert_allclose(camera.project(rays)[0], pixels, atol=1e-9)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(pixels), rays, atol=1e-12)
    assert (camera.width, camera.height) == (640, 480)


def test_a_defect_is_one_line(tmp_path):
    for change, expected in [
        (lambda text: text.replace("5 -220.0", "6 -220.0"), "polynomial: expected 6 coefficients, found 5"),
        (lambda text: text.replace("-220.0", "x"), "expected a finite number, found 'x'"),
        (lambda text: text.replace("480 640", ""), "centre, c d e and size, found 4 lines"),
        (lambda text: text.replace("-220.0", "220.0"), "expected positive fx, fy"),
    ]:
        path = write(tmp_path / "calib_results.txt")
        path.write_text(change(path.read_text()))
        assert expected in refusal(read_ocam, path)
