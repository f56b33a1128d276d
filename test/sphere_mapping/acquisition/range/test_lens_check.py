"""Images and camera_info of another lens than the rig file's are refused by name; right ones, few and bare are not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.range.lens_check import check_info, check_lenses, why_other_lens
from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Pinhole, Rig, RigCamera
from sphere_nav.geometry.cameras.camera import pixel_grid
from worlds.rig import OPTICAL

SIZE, FOCAL_LENGTH = 320, 150.0
ARGUMENTS = (SIZE, SIZE, FOCAL_LENGTH, FOCAL_LENGTH, (SIZE - 1) / 2, (SIZE - 1) / 2)
FISHEYE, PINHOLE = Fisheye(*ARGUMENTS), Pinhole(*ARGUMENTS)
RADIUS_M = 4.0


def ring(lens):
    """Return five cameras that look all around and overlap at their rims."""
    poses = [
        SE3.from_planar(0.0, 0.0, turn) @ SE3.from_parts(OPTICAL, [0.1, 0.0, 0.0])
        for turn in np.arange(5) * 2 * np.pi / 5
    ]
    return Rig(tuple(RigCamera(f"c{k}", lens, pose) for k, pose in enumerate(poses)))


def drawn(rig):
    """Return what the cameras see of a sphere of spots around them."""
    rng = np.random.default_rng(3)
    wall = cv2.GaussianBlur(rng.normal(0, 1, (1024, 2048)).astype(np.float32), (0, 0), 3)
    wall = 128 + 40 * wall / wall.std()
    images = {}
    for part in rig.cameras:
        rays = np.nan_to_num(part.camera.unproject(pixel_grid(part.camera))) @ part.T_rig_camera.rotation.T
        points = rays * RADIUS_M + part.T_rig_camera.translation
        u = (0.5 - np.arctan2(points[..., 1], points[..., 0]) / (2 * np.pi)) * 2048
        v = (0.5 - np.arcsin(points[..., 2] / np.linalg.norm(points, axis=-1)) / np.pi) * 1024
        seen = cv2.remap(wall, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        images[part.name] = np.clip(seen, 0, 255).astype(np.uint8)
    return images


@pytest.fixture(scope="module")
def images():
    return {lens.model: drawn(ring(lens)) for lens in (FISHEYE, PINHOLE)}


@pytest.mark.slow
@pytest.mark.parametrize(("told", "seen"), [(FISHEYE, "pinhole")])
def test_images_of_another_lens_are_refused_by_name(images, told, seen):
    check_lenses(ring(told), images[told.model])
    with pytest.raises(ValueError, match=f"lens: expected {told.model} .rig file., found images of a {seen}"):
        check_lenses(ring(told), images[seen])


@pytest.mark.slow
def test_images_that_fit_no_lens_are_of_other_cameras(images):
    names = list(images["fisheye"])
    elsewhere = {name: images["fisheye"][other] for name, other in zip(names, names[1:] + names[:1], strict=True)}
    rig = ring(FISHEYE)
    turned = [
        SE3.from_parts(part.T_rig_camera.rotation @ SE3.exp([0, 0, 0, 0.5 * k, 0, 0]).rotation, np.zeros(3))
        for k, part in enumerate(rig.cameras)
    ]
    wrong = replace(rig, cameras=tuple(replace(p, T_rig_camera=T) for p, T in zip(rig.cameras, turned, strict=True)))
    with pytest.raises(ValueError, match="found images of other cameras"):
        check_lenses(wrong, elsewhere)


def test_calibrations_that_bend_rays_alike_are_one_lens():
    check_info("c", PINHOLE, PINHOLE)
    check_info("c", FISHEYE, PINHOLE)  # a driver without a calibration of distortion
    check_info("c", FISHEYE, replace(FISHEYE, distortion=(0.001, 0.0, 0.0, 0.0)))
    check_info("c", DoubleSphere(*ARGUMENTS, -0.2, 0.6), FISHEYE)  # camera_info has no such model
    for theirs, what in (
        (replace(PINHOLE, distortion=(-0.3, 0.1)), "lens: expected fisheye .rig file., found pinhole whose rays"),
        (replace(FISHEYE, fx=151.0), "K.0.: expected 150.000"),
        (replace(FISHEYE, width=300), "size: expected 320 x 320 .rig file., found 300 x 320"),
    ):
        with pytest.raises(ValueError, match=f"c: {what}"):
            check_info("c", FISHEYE, theirs)
    with pytest.raises(ValueError, match="lens: expected pinhole"):
        check_info("c", PINHOLE, FISHEYE)


def test_a_lens_is_another_one_where_two_fifths_fit_it_and_clearly_fewer_the_rig_file():
    for given, other, is_told in [(0.3, 0.45, True), (0.35, 0.45, False), (0.2, 0.38, False)]:
        assert bool(why_other_lens(60, given, other, "fisheye")) == is_told
