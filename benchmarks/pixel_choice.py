"""Which pixels are aligned: before a pale wall (M15 eq. 16), and at the poles of a sphere (eq. 9).

A sphere in latitude and longitude has as many pixels in its rows at the poles as in those at its equator; of evenly
spaced points a row has as many as the cosine of its latitude allows. Both are tried in a room whose texture is on the
floor below the sphere and on the ceiling above it, with noise of two kinds: drawn for each pixel of the sphere, and
drawn in six cameras that the sphere is made of, as a rig has it: there pixels at a pole repeat each other.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.room import HALF_SIDES_M, render
from sphere_nav.geometry import SE3, Camera, Pinhole, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build
from sphere_nav.photometric import (
    Pyramid,
    Reference,
    RegistrationParams,
    View,
    build_pyramid,
    prepare_reference,
    register,
)
from sphere_nav.photometric.pixels.reference import halve_range_image, prepare_level
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

HELP = "pixels that are aligned: a pale wall at 60,000 of them; latitude and longitude against evenly spaced points"
PALE, POLAR_M = 0.15, 2.0  # contrast of what is pale; from below and above the sphere to where texture is faint
NOISE = 2.0  # grey levels
TRIALS, QUICK_TRIALS = 24, 4
GUESS_M, GUESS_RAD = 0.03, 0.01
WALL_SPHERE, WALL_CAMERA = Spherical(2048, 1024), Pinhole(640, 480, 520.0, 520.0, 319.5, 239.5)
WALL_PIXELS, ALL_PIXELS, WALL_MM = 60_000, 1_000_000, 6.4
POLE_SPHERE, POLE_PIXELS = Spherical(512, 256), (20_000, 200_000)
SHIFT_M, TURN_RAD = 0.3, 0.1  # of the known motion between two spheres
COLUMNS = ("rms mm", "rms deg", "NEES by 6", "pixels")

Image = NDArray[np.uint8]
Noise = Callable[[Spherical, np.random.Generator], Array]


@dataclass(frozen=True)
class Trial:
    """Error of one alignment in m and rad, its squared error by its covariance, and how many pixels it used."""

    distance: float
    angle: float
    nees: float
    num_pixels: int


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--choice-seed", type=int, default=71, help="of textures, noise and motions (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Measure both."""
    report = Report("pixel_choice", notes=[describe(options.threads), __doc__ or ""])
    trials = QUICK_TRIALS if options.quick else TRIALS
    face_wall(options.choice_seed, trials, report)
    look_at_poles(options.choice_seed, trials, report)
    return report


def face_wall(seed: int, trials: int, report: Report) -> None:
    """Add what a camera that sees a pale wall is worth in a sphere whose other walls have all their contrast."""
    found: dict[int, list[Trial]] = {WALL_PIXELS: [], ALL_PIXELS: []}
    for number in range(trials):
        rng = np.random.default_rng([seed, number])
        gray, range_m = render(WALL_SPHERE, SE3.identity(), number, pale_ahead)
        sphere = noisy(gray, pixel_noise(WALL_SPHERE, rng))
        pose = random_motion(rng, SHIFT_M, 0.5 * TURN_RAD) @ T_BODY_OPTICAL
        gray, _ = render(WALL_CAMERA, pose, number, pale_ahead)
        image, guess = noisy(gray, pixel_noise(WALL_CAMERA, rng)), pose @ random_motion(rng, GUESS_M, GUESS_RAD)
        for most, trials_of in found.items():
            params = build(RegistrationParams, {"max_pixels": most})
            reference = prepare_reference(sphere, range_m, WALL_SPHERE, params)
            trials_of.append(align(build_pyramid(image, WALL_CAMERA, params.pyramid), reference, guess, pose, params))
    rows = [(f"at most {most}", *cells(one)) for most, one in found.items()]
    report.tables.append(Table(f"A wall of {PALE:.0%} of the contrast of the others", ("pixels", *COLUMNS), rows))
    best, every = (rms_m(one) for one in found.values())
    count = float(np.mean([one.num_pixels for one in found[ALL_PIXELS]]))
    what = f"pale wall, {WALL_PIXELS} of {count:.0f} pixels in view"
    report.bounds += [
        Bound(f"{what}, error (of all: {1e3 * every:.2f} mm)", WALL_MM, 1e3 * best, "mm"),
        Bound(f"{what}, error by that of all, by the root of their number", 1.2,
              best / every / max(np.sqrt(count / WALL_PIXELS), 1.0), ""),
    ]  # fmt: skip


def look_at_poles(seed: int, trials: int, report: Report) -> None:
    """Add how spheres are aligned whose texture is below and above them, by either sampling."""
    rows, worst = [], 0.0
    for name, noise in (("each pixel", pixel_noise), ("six cameras", camera_noise)):
        for most in POLE_PIXELS:
            params = build(RegistrationParams, {"max_pixels": most})
            by_rows, even = zip(*(try_samplings(seed, number, noise, params) for number in range(trials)), strict=True)
            rows += [(name, str(most), "latitude, longitude", *cells(by_rows))]
            rows += [(name, str(most), "evenly spaced", *cells(even))]
            worst = max(worst, rms_m(even) / rms_m(by_rows))
    columns = ("noise of", "at most", "sampling", *COLUMNS)
    report.tables.append(Table(f"Texture at the poles, {POLE_SPHERE.width} x {POLE_SPHERE.height}", columns, rows))
    what = "texture at the poles: error by evenly spaced points over that by latitude and longitude, worst of "
    report.bounds.append(Bound(f"{what}{len(rows) // 2} cases", 1.0, worst, ""))


def try_samplings(seed: int, number: int, noise: Noise, params: RegistrationParams) -> tuple[Trial, Trial]:
    """Return one known motion by all pixels of a sphere that have a range, and by evenly spaced ones."""
    rng = np.random.default_rng([seed, number, 1])
    gray, range_m = render(POLE_SPHERE, SE3.identity(), number, pale_walls)
    image = noisy(gray, noise(POLE_SPHERE, rng))
    references = [make(image, range_m, POLE_SPHERE, params) for make in (of_all_pixels, prepare_reference)]
    pose = random_motion(rng, SHIFT_M, TURN_RAD)
    gray, _ = render(POLE_SPHERE, pose, number, pale_walls)
    pyramid = build_pyramid(noisy(gray, noise(POLE_SPHERE, rng)), POLE_SPHERE, params.pyramid)
    guess = pose @ random_motion(rng, GUESS_M, GUESS_RAD)
    one, other = (align(pyramid, made, guess, pose, params) for made in references)
    return one, other


def align(pyramid: Pyramid, reference: Reference, guess: SE3, pose: SE3, params: RegistrationParams) -> Trial:
    """Align an image with a sphere at the origin; ValueError where that does not converge."""
    alignment = register(pyramid, [View(reference, SE3.identity())], guess, params)
    if not alignment.is_converged:
        raise ValueError(f"registration: expected convergence, found {alignment.reason}")
    off = (alignment.T_world_camera.inverse() @ pose).log()
    distance, angle = alignment.T_world_camera.distance(pose)
    nees = float(off @ np.linalg.solve(alignment.covariance, off)) / 6
    return Trial(float(distance), float(angle), nees, alignment.num_pixels)


def of_all_pixels(image: Image, range_m: NDArray[np.float32], camera: Camera, params: RegistrationParams) -> Reference:
    """Return `prepare_reference` in latitude and longitude: all pixels of every row are used."""
    levels = []
    for index, level in enumerate(build_pyramid(image, camera, params.pyramid).levels):
        range_m = halve_range_image(range_m, params.surface_ratio) if index else range_m
        levels.append(prepare_level(level, range_m, params.far))
    return Reference(tuple(levels))


def pale_ahead(points_room: NDArray[np.floating]) -> Array:
    """Return the contrast of a room whose wall ahead is pale."""
    return np.where(points_room[..., 0] > HALF_SIDES_M[0] - 1e-6, PALE, 1.0)


def pale_walls(points_room: NDArray[np.floating]) -> Array:
    """Return the contrast of a room that has texture above and below its middle."""
    is_level = np.abs(points_room[..., 2]) > HALF_SIDES_M[2] - 1e-6
    near = np.exp(-np.sum(points_room[..., :2] ** 2, axis=-1) / (2 * POLAR_M**2))
    return np.where(is_level, PALE + (1.0 - PALE) * near, PALE)


def pixel_noise(camera: Camera, rng: np.random.Generator) -> Array:
    """Return noise (H, W) that is another at each pixel."""
    return rng.normal(0.0, NOISE, (camera.height, camera.width))


def camera_noise(camera: Camera, rng: np.random.Generator) -> Array:
    """Return noise (H, W) of the six sides of a cube around the sphere, whose pixels are as wide as at its equator."""
    rays = pixel_rays(camera)
    axis = np.argmax(np.abs(rays), axis=-1)
    ahead = np.take_along_axis(rays, axis[..., None], axis=-1)[..., 0]
    width = round(2 * camera.pixels_per_radian)
    noise = np.empty(axis.shape)
    for side in range(6):
        number, sign = divmod(side, 2)
        is_here = (axis == number) & ((ahead > 0) == bool(sign))
        across, up = (rays[..., (number + k) % 3][is_here] / np.abs(ahead[is_here]) for k in (1, 2))
        pixels = [((0.5 + 0.5 * one) * (width - 1)).astype(np.float32)[None] for one in (across, up)]
        face = rng.normal(0.0, NOISE, (width, width)).astype(np.float32)
        noise[is_here] = _remap(face, *pixels)
    return noise


def _remap(face: NDArray[np.float32], columns: NDArray[np.float32], rows: NDArray[np.float32]) -> Array:
    """Return an image at pixels (1, N), many at once: OpenCV takes at most 32767 in a row."""
    pieces = [
        cv2.remap(face, columns[:, k : k + 30_000], rows[:, k : k + 30_000], cv2.INTER_LINEAR)[0]
        for k in range(0, columns.shape[1], 30_000)
    ]
    return np.concatenate(pieces).astype(np.float64)


def random_motion(rng: np.random.Generator, most_m: float, most_rad: float) -> SE3:
    """Return a motion in a random direction and about a random axis, up to limits along each axis."""
    return SE3.exp(rng.uniform(-1.0, 1.0, 6) * np.repeat([most_m, most_rad], 3))


def noisy(gray: Image, noise: Array) -> Image:
    """Return an image as a camera gives it."""
    return np.clip(np.rint(gray + noise), 1, 255).astype(np.uint8)


def rms_m(trials: list[Trial] | tuple[Trial, ...]) -> float:
    """Return the root mean square of the distances."""
    return float(np.sqrt(np.mean([one.distance**2 for one in trials])))


def cells(trials: list[Trial] | tuple[Trial, ...]) -> tuple[str, ...]:
    """Return a row of a table."""
    turn = np.degrees(np.sqrt(np.mean([one.angle**2 for one in trials])))
    nees, pixels = np.mean([(one.nees, one.num_pixels) for one in trials], axis=0)
    return f"{1e3 * rms_m(trials):.2f}", f"{turn:.4f}", f"{nees:.2f}", f"{pixels:.0f}"
