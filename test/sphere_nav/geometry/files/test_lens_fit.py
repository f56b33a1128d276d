"""A lens of ours is found again; what none of ours stands in for is refused with its residual."""

import numpy as np
import pytest

from sphere_nav.geometry import DoubleSphere, Fisheye
from sphere_nav.geometry.files.lens_fit import fit_lens, grid_of

SIZE = (640, 480)


@pytest.mark.parametrize(
    "camera",
    [
        DoubleSphere(*SIZE, 190.0, 191.0, 322.0, 238.0, -0.2, 0.58),
        Fisheye(*SIZE, 200.0, 201.0, 318.0, 241.0, (0.01, -0.005, 0.002, -0.0004)),
    ],
    ids=["double_sphere", "fisheye"],
)
def test_a_lens_of_ours_is_found_again(camera):
    pixels = grid_of(SIZE)
    rays = camera.unproject(pixels)
    fit = fit_lens(rays, pixels, SIZE, 250.0, "file")
    assert fit.max_px < 1e-3
    np.testing.assert_allclose(fit.camera.project(rays)[0], pixels, atol=1e-3)


def test_what_none_of_ours_stands_in_for_is_refused_with_its_residual():
    pixels = grid_of(SIZE)
    bent = pixels + 4.0 * np.sin(pixels[:, ::-1] / 20.0)
    rays = Fisheye(*SIZE, 200.0, 200.0, 319.5, 239.5).unproject(bent)
    with pytest.raises(ValueError, match=r"file: expected a lens .* within 0\.3 px RMS and 1\.0 px, found \d"):
        fit_lens(rays, pixels, SIZE, 200.0, "file")
