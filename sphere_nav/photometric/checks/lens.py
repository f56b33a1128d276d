"""Do the residuals say that the lens is another one than camera_info tells?

A wrong focal length or distortion moves the image about its centre, by a share that is even, or grows with the square
of the distance from it. A pose can take over most of that, and errs by decimetres: a street that is seen 2 % too large
is one that is 0.2 m nearer. Not all: what is far away and what is near ask for another step. So the share is estimated
together with pose and light: where a look at a coarser level shows one, step by step, with the image redrawn by it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from sphere_nav.estimation.normal_equations import scaled_inverse
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.bias import linearize_samples, solve_robustly
from sphere_nav.photometric.constants import LENS_DONE, LENS_LEVELS, LENS_LOOK, LENS_PIECES, MAX_SHARE
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Level, Pyramid
from sphere_nav.photometric.pixels.samples import CameraSamples

# Means over an image of the products of 1 and r^2, r being 1 at its corners, its sides as 4 to 3.
MEAN_PRODUCTS = np.array([[1.0, 1.0 / 3.0], [1.0 / 3.0, 0.16]])
SampleImages = Callable[[Sequence[RigImage], SE3], CameraSamples]


@dataclass(frozen=True, eq=False)
class LensError:
    """What an image tells of one camera: it is larger about its centre than the lens says by the share s + k r^2.

    share (2,) is (s, k), r is 1 at the corners; covariance (2, 2) is by how differently parts of the image tell it.
    by_share (6, 2) is xi from the aligned pose to that with another share.
    """

    share: Array
    covariance: Array
    by_share: Array
    name: str = ""  # of the camera


@dataclass(frozen=True, eq=False)
class _Step:
    xi: Array  # (6,) of the body
    shares: Array  # (cameras, 2)
    covariance: Array  # (2 cameras, 2 cameras)
    by_share: Array  # (6, 2 cameras)


def mean_share(share: Array) -> float:
    """Return by how much a share moves the pixels of an image, root of the mean square over all of it."""
    return float(np.sqrt(share @ MEAN_PRODUCTS @ share))


def find_lens_errors(
    images: Sequence[RigImage],
    cameras: CameraSamples,
    T_world_body: SE3,
    params: RegistrationParams,
    sample: SampleImages,
) -> tuple[tuple[LensError, ...], CameraSamples]:
    """Return what aligned images tell of their lenses, none of whole spheres, and their pixels with those lenses.

    `cameras` are their pixels at the finest level, `sample` gives those of redrawn images, there or at other levels.
    Nothing is told where too little is seen.
    """
    pose, shares = T_world_body, np.zeros((len(images), 2))
    step = _solve(sample(_redraw(images, params, LENS_LOOK, shares), pose), params)
    is_small = step is not None and max(map(mean_share, step.shares)) < LENS_DONE
    if is_small:
        step = _solve(cameras, params)
        shares = step.shares if step is not None else shares
    for coarser in () if is_small else LENS_LEVELS:
        cameras = sample(_redraw(images, params, coarser, shares), pose)
        step = _solve(cameras, params)
        if step is None or max(map(mean_share, shares + step.shares)) > MAX_SHARE:
            return (), cameras
        pose, shares = pose @ SE3.exp(step.xi), shares + step.shares
    if step is None:
        return (), cameras
    found = []
    for index, image in enumerate(images):
        own = slice(2 * index, 2 * index + 2)
        if not isinstance(image.pyramid.cameras[0], Spherical):
            parts = step.covariance[own, own], step.by_share[:, own]
            found.append(LensError(shares[index], *parts, image.name))
    return tuple(found), cameras


def _solve(cameras: CameraSamples, params: RegistrationParams) -> _Step | None:
    """Solve for pose, light and lenses together; pieces of the pixels in scan order tell how surely."""
    problem = linearize_samples(cameras, ())
    if problem is None:
        return None
    J, residual, owner = problem
    by_lens, first = np.zeros((len(residual), 2 * len(cameras))), 0
    for index, (_, samples) in enumerate(cameras):
        last = first + sum(len(sample.residual) for sample in samples)
        if last > first:
            by_lens[first:last, 2 * index : 2 * index + 2] = np.concatenate([sample.by_lens for sample in samples])
        first = last
    x, _, weight = solve_robustly(np.hstack([J, by_lens]), residual, owner, params)
    weighted, lens = weight[:, None] * J, slice(J.shape[1], None)
    by_share = -scaled_inverse(weighted.T @ J) @ (weighted.T @ by_lens)
    alone = by_lens + J @ by_share  # what no pose and no light takes over
    inverse = scaled_inverse((weight[:, None] * alone).T @ alone)
    scores = (weight * residual)[:, None] * alone
    pieces = [part.sum(axis=0) for k in np.unique(owner) for part in np.array_split(scores[owner == k], LENS_PIECES)]
    pulls = (np.array(pieces) - np.mean(pieces, axis=0)) @ inverse
    return _Step(x[:6], x[lens].reshape(-1, 2), pulls.T @ pulls, by_share[:6])


def _redraw(images: Sequence[RigImage], params: RegistrationParams, coarser: int, shares: Array) -> list[RigImage]:
    """Return images, at one level alone, as lenses without errors of such shares would have drawn them."""
    index = params.pyramid.finest + coarser
    levels = [one.pyramid.levels[min(index, len(one.pyramid.levels) - 1)] for one in images]
    drawn = [_stretch(level, share) if share.any() else level for level, share in zip(levels, shares, strict=True)]
    return [replace(one, pyramid=Pyramid((level,))) for one, level in zip(images, drawn, strict=True)]


def _stretch(level: Level, share: Array) -> Level:
    v, u = np.indices(level.image.shape, np.float32)
    center = 0.5 * (np.array(level.image.shape[::-1], np.float32) - 1.0)
    u, v = u - center[0], v - center[1]
    larger = np.float32(1.0 + share[0]) + np.float32(share[1] / np.sum(center**2)) * (u**2 + v**2)
    pixels = center[0] + larger * u, center[1] + larger * v
    image = level.image.astype(np.float32)
    drawn = cv2.remap(image, *pixels, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
    return Level(drawn, level.camera, level.pad)
