"""What the residuals say beyond the pose: do the gradients agree, and would another lens explain the image better?

Grey levels of smooth surfaces correlate by chance wherever a fit may slide; their gradients do not. A wrong lens leaves
residuals that point to the centre of the image or away from it. Both are asked of a few thousand pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photometric.alignment import Alignment
from photometric.descent.kernels import SIGMA_OF_MAD
from photometric.iteration import kernels
from photometric.iteration.kernels import BLOCK, SIDE
from photometric.params import RegistrationParams
from photometric.projection import Floats, KernelCamera, kernel_motion, rolling
from photometric.pyramid import Level, Pyramid
from photometric.reference import Selection, View
from photometric.rig import RigImage, share_pixels
from photometric.robust import huber_weights, median_and_mad
from photometric.selection import choose
from sphere_geometry import FrameMotion, Spherical

Array = NDArray[np.float64]
NUM_PIXELS = 2048  # looked at, all references together
NUM_PIECES = 24  # of the pixels in scan order: pixels of a piece may err together
MIN_PIXELS = 100
RIDGE, TINY = 1e-9, 1e-12


@dataclass(frozen=True)
class Structure:
    """What the residuals of an alignment look like.

    agreement is the mean cosine -1...1 between the gradients of image and references. stretch is by how much the image
    is larger about its centre than the lens says, as a share, with its standard deviation; 0 and infinite where no lens
    is known (whole spheres) or too little is seen.
    """

    agreement: float
    stretch: float = 0.0
    stretch_sigma: float = np.inf


def find_rig_structure(
    images: Sequence[RigImage], alignment: Alignment, params: RegistrationParams, motion: FrameMotion | None = None
) -> Structure:
    """Look at an alignment of `register_rig`: the mean agreement, and the lens that is most surely wrong."""
    found, first, share = [], 0, share_pixels(params, len(images))
    for image in images:
        part = slice(first, first + len(image.views))
        pose, gains, biases = image.pose(alignment.T_world_camera), alignment.gains[part], alignment.biases[part]
        own = replace(alignment, T_world_camera=pose, gains=gains, biases=biases)
        found.append(find_structure(image.pyramid, image.views, own, share, image.motion(motion)))
        first = part.stop
    surest = max(found, key=lambda one: abs(one.stretch) / one.stretch_sigma)
    return replace(surest, agreement=float(np.mean([one.agreement for one in found])))


@dataclass(frozen=True)
class _Sample:
    """Pixels of one view: points (N, 3) m in the camera, gradients by the point (N, 3) in both images, residuals (N,).

    by_stretch (N,) is the derivative of the residual by the stretch, current (N,) the grey level of the image.
    """

    points: Array
    of_reference: Array
    of_image: Array
    by_stretch: Array
    current: Array
    residual: Array


def find_structure(
    pyramid: Pyramid,
    views: Sequence[View],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
) -> Structure:
    """Look at an alignment of `register` with the same arguments; what it says of too few pixels is nothing."""
    samples = _samples(pyramid, views, alignment, params, motion)
    has_lens = not isinstance(pyramid.cameras[0], Spherical)
    samples = [sample for sample in samples if len(sample.residual) >= MIN_PIXELS]
    if not samples:
        return Structure(0.0)
    return Structure(_agreement(samples), *_stretch(samples, params, has_lens=has_lens))


def view_residuals(
    images: Sequence[RigImage], alignment: Alignment, params: RegistrationParams, motion: FrameMotion | None = None
) -> Iterator[tuple[View, Array, Array]]:
    """Yield each view of an alignment of `register_rig` with points (N, 3) of it, its axes, and residuals (N,)."""
    first, share = 0, share_pixels(params, len(images))
    for image in images:
        part = slice(first, first + len(image.views))
        pose, gains, biases = image.pose(alignment.T_world_camera), alignment.gains[part], alignment.biases[part]
        own = replace(alignment, T_world_camera=pose, gains=gains, biases=biases)
        samples = _samples(image.pyramid, image.views, own, share, image.motion(motion))
        for view, sample in zip(image.views, samples, strict=True):
            if len(sample.residual) >= MIN_PIXELS:
                yield view, (view.T_world_reference.inverse() @ pose).apply(sample.points), sample.residual
        first = part.stop


def _samples(
    pyramid: Pyramid,
    views: Sequence[View],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None,
) -> list[_Sample]:
    """Return some pixels of each view, warped into the image."""
    level = pyramid.levels[min(params.pyramid.finest, len(pyramid.levels) - 1)]
    camera = level.kernel_camera if motion is None else rolling(level.camera, motion.twist(alignment.T_world_camera))
    T_camera_world = alignment.T_world_camera.inverse()
    samples = []
    for view, gain, bias in zip(views, alignment.gains, alignment.biases, strict=True):
        T = T_camera_world @ view.T_world_reference
        pixels = view.reference.level_like(level.camera)
        selection = choose(pixels, T, level.camera, params.max_pixels // len(views))
        blocks = _some(selection, NUM_PIXELS // len(views))
        samples.append(_sample(blocks, kernel_motion(T.matrix), camera, level, (gain, bias)))
    return samples


def _some(selection: Selection, number: int) -> Floats:
    """Return blocks of about so many of the chosen pixels, evenly taken."""
    step = max(1, selection.num_pixels // number)
    some = selection.blocks.reshape(-1, BLOCK // SIDE, SIDE)[:, :, ::step]
    rows = some.transpose(1, 0, 2).reshape(BLOCK // SIDE, -1)
    count = -(-rows.shape[1] // SIDE)
    blocks = np.full((BLOCK // SIDE, count * SIDE), np.nan, np.float32)
    blocks[:, : rows.shape[1]] = rows
    return np.ascontiguousarray(blocks.reshape(-1, count, SIDE).swapaxes(0, 1)).reshape(-1)


def _sample(blocks: Floats, T: Floats, camera: KernelCamera, level: Level, light: tuple[float, float]) -> _Sample:
    """Warp pixels of a reference into the image."""
    height, width = level.camera.height, level.camera.width
    gain, bias, *centre = (np.float32(value) for value in (*light, 0.5 * (width - 1), 0.5 * (height - 1)))
    out = np.empty((kernels.NUM_WARPED, blocks.size // BLOCK * SIDE), np.float32)
    kernels.warp(blocks, T, camera, level.samples, gain, bias, *centre, out)
    seen = out[:-1, out[-1] > 0.0].astype(np.float64)
    points, of_reference, of_image = (np.ascontiguousarray(rows.T) for rows in np.split(seen[:9], 3))
    return _Sample(points, of_reference, of_image, *seen[9:])


def _agreement(samples: Sequence[_Sample]) -> float:
    """Return the mean cosine between the gradients, each pixel by how strong it is in the reference.

    By direction alone in the image: what covers a part of the view counts by its share, not by its contrast.
    """
    agreeing = total = 0.0
    for sample in samples:
        length = np.sqrt(np.einsum("ni,ni->n", sample.points, sample.points))
        in_reference, in_image = (np.sqrt(np.einsum("ni,ni->n", g, g)) for g in (sample.of_reference, sample.of_image))
        cosine = np.einsum("ni,ni->n", sample.of_reference, sample.of_image) / np.maximum(in_reference * in_image, TINY)
        agreeing += float(np.sum(length * in_reference * cosine))
        total += float(np.sum(length * in_reference))
    return agreeing / max(total, TINY)


def _stretch(samples: Sequence[_Sample], params: RegistrationParams, *, has_lens: bool) -> tuple[float, float]:
    """Return the stretch and its standard deviation, estimated with pose and light; pieces tell how pixels scatter."""
    if not has_lens:
        return 0.0, np.inf
    size = 7 + 2 * len(samples)
    H, scores = np.zeros((size, size)), []
    for index, sample in enumerate(samples):
        median, mad = median_and_mad(sample.residual)
        sigma = max(SIGMA_OF_MAD * mad, params.min_sigma)
        weight = huber_weights(sample.residual, median, params.huber * sigma) / sigma**2
        J = np.zeros((len(sample.residual), size))
        J[:, :3], J[:, 3:6] = -sample.of_image, np.cross(sample.of_image, sample.points)
        J[:, 6] = sample.by_stretch
        J[:, 7 + 2 * index], J[:, 8 + 2 * index] = sample.current, 1.0
        weighted = weight[:, None] * J
        H += weighted.T @ J
        parts = np.array_split(weighted * sample.residual[:, None], NUM_PIECES)
        scores += [part.sum(axis=0) for part in parts]
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(H), 1e-300))
    inverse = np.linalg.inv(H * np.outer(scale, scale) + RIDGE * np.eye(size)) * np.outer(scale, scale)
    pulls = np.array(scores) @ inverse  # of each piece on every unknown
    step = -pulls.sum(axis=0)
    scatter = np.sum((pulls[:, 6] - pulls[:, 6].mean()) ** 2)
    return float(step[6]), float(np.sqrt(scatter))
