"""What the residuals say beyond the pose: do the gradients agree, do another lens, light or a hidden part explain them?

Grey levels of smooth surfaces correlate by chance wherever a fit may slide; their gradients do not. A wrong lens leaves
residuals that point to the centre of the image or away from it; light: `uneven_light.py`; what stands before the
camera: `hidden_part.py`. All is asked of a few thousand pixels, together or one after the other in different images.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Flag, auto

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.robust import weigh
from sphere_nav.geometry import SE3, FrameMotion, Spherical
from sphere_nav.photometric.align.alignment import Alignment
from sphere_nav.photometric.align.rig import RigImage, share_pixels
from sphere_nav.photometric.checks.bias import NO_PULL, Cameras, Look, Pull
from sphere_nav.photometric.checks.illumination import find_pull
from sphere_nav.photometric.checks.occlusion import MIN_SHARE, find_hidden, free_of
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Pyramid
from sphere_nav.photometric.pixels.reference import View
from sphere_nav.photometric.pixels.samples import TINY, Sample, cosines, take_samples

Array = NDArray[np.float64]
NUM_PIECES = 24  # of the pixels in scan order: pixels of a piece may err together
MIN_PIXELS = 100
RIDGE = 1e-9


class Aspect(Flag):
    """What may be asked of residuals: gradients and lens, a hidden part of the view, light that varies over it."""

    FIT = auto()
    HIDDEN = auto()
    LIGHT = auto()


NOTHING, EVERYTHING = Aspect(0), Aspect.FIT | Aspect.HIDDEN | Aspect.LIGHT


@dataclass(frozen=True)
class Structure:
    """What the residuals of an alignment look like; what was not asked is as if nothing were wrong.

    agreement is the mean cosine -1...1 between the gradients of image and references. stretch is by how much the image
    is larger about its centre than the lens says, as a share, with its standard deviation; 0 and infinite where no lens
    is known (whole spheres) or too little is seen. pull is that of light that varies over the view, hidden that of what
    hides a part of it.
    """

    agreement: float = 1.0
    stretch: float = 0.0
    stretch_sigma: float = np.inf
    pull: Pull = NO_PULL
    hidden: Pull = NO_PULL


def find_rig_structure(
    images: Sequence[RigImage],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
    asked: Aspect = EVERYTHING,
) -> Structure:
    """Look at an alignment of `register_rig`: the mean agreement, the lens that is most surely wrong, the pull of all.

    What it says of too few pixels is nothing.
    """

    def look_at(T_world_body: SE3) -> Cameras:
        there = _samples_of(images, replace(alignment, T_world_camera=T_world_body), params, motion)
        return [
            (one.T_body_camera, [part for part in parts if len(part.residual) >= MIN_PIXELS]) for one, parts in there
        ]

    look: Look = look_at
    pose = alignment.T_world_camera
    cameras = look(pose)
    found = _find_fit(images, cameras, params) if Aspect.FIT in asked else Structure()
    if Aspect.HIDDEN in asked:
        found = replace(found, hidden=find_hidden(look, cameras, pose, params))
    if Aspect.LIGHT not in asked:
        return found
    if found.hidden.share >= MIN_SHARE:  # of the light, what is free of the view tells more
        look, pose = free_of(look), pose @ SE3.exp(found.hidden.xi)
        cameras = look(pose)
    return replace(found, pull=find_pull(look, cameras, pose, params))


def _find_fit(images: Sequence[RigImage], cameras: Cameras, params: RegistrationParams) -> Structure:
    """Return the mean agreement of gradients and the stretch that is most sure."""
    found = []
    for image, (_, usable) in zip(images, cameras, strict=True):
        has_lens = not isinstance(image.pyramid.cameras[0], Spherical)
        found.append(Structure(_agreement(usable), *_stretch(usable, params, has_lens=has_lens)))
    surest = max(found, key=lambda one: abs(one.stretch) / one.stretch_sigma)
    return replace(surest, agreement=float(np.mean([one.agreement for one in found])))


def find_structure(
    pyramid: Pyramid,
    views: Sequence[View],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
) -> Structure:
    """Look at an alignment of `register` with the same arguments."""
    return find_rig_structure([RigImage(pyramid, views=tuple(views))], alignment, params, motion)


def view_residuals(
    images: Sequence[RigImage], alignment: Alignment, params: RegistrationParams, motion: FrameMotion | None = None
) -> Iterator[tuple[View, Array, Array]]:
    """Yield each view of an alignment of `register_rig` with points (N, 3) of it, its axes, and residuals (N,)."""
    for image, samples in _samples_of(images, alignment, params, motion):
        pose = image.pose(alignment.T_world_camera)
        for view, sample in zip(image.views, samples, strict=True):
            if len(sample.residual) >= MIN_PIXELS:
                yield view, (view.T_world_reference.inverse() @ pose).apply(sample.points), sample.residual


def _samples_of(
    images: Sequence[RigImage], alignment: Alignment, params: RegistrationParams, motion: FrameMotion | None
) -> Iterator[tuple[RigImage, list[Sample]]]:
    """Yield each image of an alignment of `register_rig` with pixels of each of its views."""
    first, share = 0, share_pixels(params, len(images))
    for image in images:
        part = slice(first, first + len(image.views))
        pose, gains, biases = image.pose(alignment.T_world_camera), alignment.gains[part], alignment.biases[part]
        own = replace(alignment, T_world_camera=pose, gains=gains, biases=biases)
        yield image, take_samples(image.pyramid, image.views, own, share, image.motion(motion))
        first = part.stop


def _agreement(samples: Sequence[Sample]) -> float:
    """Return the mean cosine between the gradients, each pixel by how strong it is in the reference."""
    agreeing = total = 0.0
    for sample in samples:
        cosine, weight = cosines(sample)
        agreeing += float(np.sum(weight * cosine))
        total += float(np.sum(weight))
    return agreeing / max(total, TINY)


def _stretch(samples: Sequence[Sample], params: RegistrationParams, *, has_lens: bool) -> tuple[float, float]:
    """Return the stretch and its standard deviation, estimated with pose and light; pieces tell how pixels scatter."""
    if not has_lens or not samples:
        return 0.0, np.inf
    size = 7 + 2 * len(samples)
    H, scores = np.zeros((size, size)), []
    for index, sample in enumerate(samples):
        weight, _ = weigh(sample.residual, params.huber, params.min_sigma)
        J = np.zeros((len(sample.residual), size))
        J[:, :6], J[:, 6] = sample.by_pose, sample.by_stretch
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
