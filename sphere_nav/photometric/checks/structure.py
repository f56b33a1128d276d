"""What the residuals say beyond the pose: do gradients agree, do another lens, light or an occlusion explain them?

Grey levels of smooth surfaces correlate by chance wherever a fit may slide; their gradients do not. Where they agree
little, each part of the view is asked for itself: `support.py`. A wrong lens leaves residuals that point to the centre
of the image or away from it; light: `illumination.py`; what stands before the camera: `occlusion.py`. All use a few
thousand pixels, together or one after the other in different images.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Flag, auto

import numpy as np

from sphere_nav.estimation.normal_equations import scaled_inverse
from sphere_nav.estimation.robust import weigh
from sphere_nav.geometry import SE3, FrameMotion, Spherical
from sphere_nav.geometry.arrays import TINY
from sphere_nav.photometric.align.alignment import Alignment
from sphere_nav.photometric.align.rig import RigImage, share_pixels
from sphere_nav.photometric.checks.bias import NO_BIAS, PoseBias
from sphere_nav.photometric.checks.illumination import find_illumination_bias
from sphere_nav.photometric.checks.occlusion import exclude_occlusion, find_occlusion_bias
from sphere_nav.photometric.checks.support import NO_SUPPORT, Support, exclude_changes, find_support
from sphere_nav.photometric.constants import LENS_PIECES, MIN_SAMPLES, OCCLUSION_SHARE, SURE_AGREEMENT, SURE_NCC
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.samples import CameraSamples, Sample, Sampler, cosines, sample_views


class Aspect(Flag):
    """What may be checked of residuals: gradients and lens, an occlusion, an illumination gradient."""

    FIT = auto()
    OCCLUSION = auto()
    ILLUMINATION = auto()


NOTHING = Aspect(0)
EVERYTHING = Aspect.FIT | Aspect.OCCLUSION | Aspect.ILLUMINATION


@dataclass(frozen=True)
class Structure:
    """What the residuals of an alignment look like; what was not checked is as if nothing were wrong.

    agreement is the mean cosine -1...1 between the gradients of image and references. stretch is by how much the image
    is larger about its centre than the lens says, as a share, with its standard deviation; 0 and infinite where no lens
    is known (whole spheres) or too little is seen. illumination and occlusion are the biases of the pose by a gradient
    of the light over the view, and by what hides a part of it. support is what the parts of the view say where the mean
    agreement is low; where it is proven, the pose without the other parts is in it, and no occlusion is looked for.
    """

    agreement: float = 1.0
    stretch: float = 0.0
    stretch_sigma: float = np.inf
    illumination: PoseBias = NO_BIAS
    occlusion: PoseBias = NO_BIAS
    support: Support = NO_SUPPORT


def find_rig_structure(
    images: Sequence[RigImage],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
    aspects: Aspect = EVERYTHING,
    T_predicted: SE3 | None = None,
) -> Structure:
    """Check an alignment of `register_rig`: the mean agreement, the lens that is most surely wrong, the biases.

    Of too few pixels it says nothing. A pose that was predicted is one more that parts of the view may support.
    """

    def sample_at(T_world_body: SE3) -> CameraSamples:
        there = samples_of(images, replace(alignment, T_world_camera=T_world_body), params, motion)
        return [
            (one.T_body_camera, [part for part in parts if len(part.residual) >= MIN_SAMPLES]) for one, parts in there
        ]

    sampler: Sampler = sample_at
    pose = alignment.T_world_camera
    cameras = sampler(pose)
    found = _find_fit(images, cameras, params) if Aspect.FIT in aspects else Structure()
    if Aspect.FIT in aspects and (found.agreement < SURE_AGREEMENT or alignment.ncc < SURE_NCC):
        found = replace(found, support=find_support(images, sampler, pose, params, T_predicted))
    if found.support.is_proven:
        sampler, pose = exclude_changes(images, sampler, params), pose @ SE3.exp(found.support.xi)
        cameras = sampler(pose) if Aspect.ILLUMINATION in aspects else cameras
    elif Aspect.OCCLUSION in aspects:
        found = replace(found, occlusion=find_occlusion_bias(sampler, cameras, pose, params))
    if Aspect.ILLUMINATION not in aspects:
        return found
    if found.occlusion.share >= OCCLUSION_SHARE:  # of the light, the pixels without occlusion tell more
        sampler, pose = exclude_occlusion(sampler), pose @ SE3.exp(found.occlusion.xi)
        cameras = sampler(pose)
    return replace(found, illumination=find_illumination_bias(sampler, cameras, pose, params))


def _find_fit(images: Sequence[RigImage], cameras: CameraSamples, params: RegistrationParams) -> Structure:
    """Return the mean agreement of gradients and the stretch that is most sure."""
    found = []
    for image, (_, usable) in zip(images, cameras, strict=True):
        has_lens = not isinstance(image.pyramid.cameras[0], Spherical)
        found.append(Structure(_agreement(usable), *_stretch(usable, params, has_lens=has_lens)))
    surest = max(found, key=lambda one: abs(one.stretch) / one.stretch_sigma)
    return replace(surest, agreement=float(np.mean([one.agreement for one in found])))


def samples_of(
    images: Sequence[RigImage], alignment: Alignment, params: RegistrationParams, motion: FrameMotion | None
) -> Iterator[tuple[RigImage, list[Sample]]]:
    """Yield each image of an alignment of `register_rig` with pixels of each of its views."""
    first, share = 0, share_pixels(params, len(images))
    for image in images:
        part = slice(first, first + len(image.views))
        pose, gains, biases = image.pose(alignment.T_world_camera), alignment.gains[part], alignment.biases[part]
        own = replace(alignment, T_world_camera=pose, gains=gains, biases=biases)
        yield image, sample_views(image.pyramid, image.views, own, share, image.motion(motion))
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
        parts = np.array_split(weighted * sample.residual[:, None], LENS_PIECES)
        scores += [part.sum(axis=0) for part in parts]
    steps = np.array(scores) @ scaled_inverse(H)  # of each piece on every unknown
    step = -steps.sum(axis=0)
    scatter = np.sum((steps[:, 6] - steps[:, 6].mean()) ** 2)
    return float(step[6]), float(np.sqrt(scatter))
