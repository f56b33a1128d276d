"""A textured sphere around a rig, in closed form: the stitched image and range are those of the true sphere."""

import cv2
import numpy as np
import pytest

from sphere_geometry import SE3, Fisheye, Rig, RigCamera, Spherical
from sphere_geometry.camera import pixel_grid
from sphere_mapping.stitching import blending, epipolar, exposure, fusion, kernels, matching, pairs, views  # noqa: F401
from sphere_mapping.stitching.params import FusionParams, StitchParams
from sphere_mapping.stitching.stitcher import Stitcher
from typed_params import build

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LENS = Fisheye(160, 160, 48.0, 48.0, 79.5, 79.5)
RADIUS = 3.0  # m, of the sphere of texture
WIDTH = 256


def texture(points):
    """Grey levels (...,) of directions: smooth, without period, the same for every camera."""
    rays = points / np.linalg.norm(points, axis=-1, keepdims=True)
    waves = np.random.default_rng(0).normal(size=(24, 3)) * 9
    return 128 + 14 * np.sum(np.sin(rays @ waves.T + np.arange(24)), axis=-1)


def seen(part):
    """What a camera sees: its rays meet the sphere of texture around the rig's origin."""
    rays = part.T_rig_camera.rotation @ np.nan_to_num(LENS.unproject(pixel_grid(LENS)), nan=0.5)[..., None]
    rays, origin = rays[..., 0], part.T_rig_camera.translation
    along = rays @ origin
    reach = -along + np.sqrt(along**2 + RADIUS**2 * np.sum(rays * rays, axis=-1) - origin @ origin)
    return np.clip(np.rint(texture(origin + reach[..., None] * rays)), 1, 255).astype(np.uint8)


def vertical_rig():
    parts = []
    for level, z in (("top", 0.15), ("bottom", -0.15)):
        for name, azimuth in (("front", 0.0), ("left", 2.1), ("right", -2.1)):
            pose = SE3.from_planar(0.0, 0.0, azimuth) @ SE3.from_parts(OPTICAL, [0.02, 0.0, z])
            parts.append(RigCamera(f"{level}_{name}", LENS, pose, exposure_group=f"{name}", level=level))
    return Rig(tuple(parts))


@pytest.fixture(scope="module")
def stitcher():
    kernels.warm_up()
    return Stitcher(vertical_rig(), build(StitchParams, {"width": WIDTH, "match.max_disparity_deg": 12.0}))


@pytest.fixture(scope="module")
def images(stitcher):
    return {part.name: seen(part) for part in stitcher.rig.cameras}


def truth(stitcher):
    rays = stitcher.whole.unproject(pixel_grid(stitcher.whole))
    z = stitcher.T_rig_sphere.translation[2]
    range_m = -rays[..., 2] * z + np.sqrt((rays[..., 2] * z) ** 2 + RADIUS**2 - z * z)
    points = rays * range_m[..., None] + stitcher.T_rig_sphere.translation
    return texture(points), range_m


def test_image_and_range_are_those_of_the_scene(stitcher, images):
    found = stitcher.stitch(images)
    levels, range_m = truth(stitcher)
    measured = found.sphere.measured
    middle = np.abs(np.arange(WIDTH // 2) - WIDTH / 4) < WIDTH / 8  # within 45 degrees of the horizon
    assert measured[middle].mean() > 0.8
    relative = np.abs(found.sphere.range_m - range_m)[measured] / range_m[measured]
    assert np.median(relative) < 0.03  # disparity is 4 px: a tenth of a pixel
    error = found.sphere.image.astype(float) - levels
    assert np.sqrt(np.mean(error[middle] ** 2)) < 6  # two interpolations of a texture of 20 px period
    assert found.missing == ()


def test_no_seam_where_the_columns_wrap_around(stitcher, images):
    image = stitcher.stitch(images).sphere.image.astype(float)
    across, inside = np.abs(image[:, 0] - image[:, -1]), np.abs(np.diff(image, axis=1))
    assert across.mean() < 1.5 * inside.mean()


def test_the_result_does_not_depend_on_the_number_of_threads(stitcher, images):
    other = Stitcher(stitcher.rig, stitcher.params, jobs=3)
    a, b = stitcher.stitch(images).sphere, other.stitch(images).sphere
    np.testing.assert_array_equal(a.image, b.image)
    np.testing.assert_array_equal(a.range_m, b.range_m)


def test_a_missing_camera_is_named_and_leaves_a_hole(stitcher, images):
    rest = {name: image for name, image in images.items() if not name.endswith("_left")}
    found = stitcher.stitch(rest)
    assert found.missing == ("top_left", "bottom_left")
    assert 0 < np.mean(found.sphere.image == 0) < 0.5
    assert np.isnan(found.sphere.range_m[found.sphere.image == 0]).all()


def test_exposure_is_made_equal(stitcher, images):
    dark = {
        name: cv2.convertScaleAbs(image, alpha=0.7 if name.endswith("front") else 1.0) for name, image in images.items()
    }
    gains = stitcher.stitch(dark).gains
    assert gains["top_front"][0] / gains["top_left"][0] == pytest.approx(1 / 0.7, rel=0.03)


def test_wrong_images_are_refused_by_name(stitcher, images):
    with pytest.raises(ValueError, match="top_left: image: expected 160 x 160"):
        stitcher.stitch(images | {"top_left": np.ones((10, 10), np.uint8)})
    with pytest.raises(ValueError, match="expected a camera roof, found top_front"):
        stitcher.stitch(images | {"roof": images["top_left"]})
    with pytest.raises(ValueError, match="expected at least one image"):
        stitcher.stitch({})


def test_two_cameras_side_by_side_give_range():
    poses = [SE3.from_parts(OPTICAL, [0.0, y, 0.0]) for y in (0.15, -0.15)]
    rig = Rig(tuple(RigCamera(name, LENS, pose) for name, pose in zip("ab", poses, strict=True)))
    stitcher = Stitcher(rig, build(StitchParams, {"width": WIDTH, "match.max_disparity_deg": 12.0}))
    assert [(pair.first, pair.second) for pair in stitcher.pairs] == [("a", "b")]
    found = stitcher.stitch({part.name: seen(part) for part in rig.cameras}).sphere
    assert found.measured.mean() > 0.2
    assert np.nanmedian(np.abs(found.range_m[found.measured] - RADIUS)) / RADIUS < 0.03


def test_ranges_are_fused_by_their_variance():
    def plane(value):
        return np.full((2, 2), value, np.float32)

    near, nearly, other = (plane(10.0), plane(0.1)), (plane(10.2), plane(0.1)), (plane(20.0), plane(1.0))
    range_m, std_m = fusion.fused([other, near, nearly], FusionParams())
    np.testing.assert_allclose(range_m, 10.1, atol=1e-5)
    np.testing.assert_allclose(std_m, 0.1 / np.sqrt(2), rtol=1e-5)


def test_the_nearest_point_of_a_cloud_hides_the_others():
    whole = Spherical(64, 32)
    range_m, _ = fusion.range_from_cloud(
        np.array([[5.0, 0.0, 0.0], [9.0, 0.0, 0.0], [np.nan, 0, 0]]), whole, FusionParams()
    )
    assert np.nanmin(range_m) == np.nanmax(range_m) == 5.0
