"""What the residuals say beyond the pose: do gradients agree, does an occlusion explain them?

Grey levels of smooth surfaces correlate by chance wherever a fit may slide; their gradients do not. Where they agree
little, each part of the view is asked for itself: `support.py`; what stands before the camera: `occlusion.py`. Both
use a few thousand pixels, together or one after the other in different images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Flag, auto

from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import TINY
from sphere_nav.photometric.align.judgement import Alignment
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.bias import NO_BIAS, PoseBias
from sphere_nav.photometric.checks.occlusion import find_occlusion_bias
from sphere_nav.photometric.checks.support import NO_SUPPORT, Support, find_support
from sphere_nav.photometric.constants import MIN_SAMPLES, SURE_AGREEMENT, SURE_NCC
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.parts.votes import Votes, vote
from sphere_nav.photometric.pixels.samples import Sample, cosines, sample_images


class Aspect(Flag):
    """What may be checked of residuals: gradients, an occlusion, how likely the place is."""

    FIT = auto()
    OCCLUSION = auto()
    PLACE = auto()


NOTHING = Aspect(0)
EVERYTHING = Aspect.FIT | Aspect.OCCLUSION


@dataclass(frozen=True)
class Structure:
    """What the residuals of an alignment look like; what was not checked is as if nothing were wrong.

    agreement is the mean cosine -1...1 between the gradients of image and references. occlusion is the bias of the pose
    by what hides a part of the view. support is what its parts say where the mean agreement is low; where it is proven,
    the pose without the other parts is in it, and no occlusion is looked for. chance is how probably as many parts
    agree in a wrong place.
    """

    agreement: float = 1.0
    occlusion: PoseBias = NO_BIAS
    support: Support = NO_SUPPORT
    chance: float = 1.0


def find_rig_structure(
    images: Sequence[RigImage],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
    aspects: Aspect = EVERYTHING,
    T_predicted: SE3 | None = None,
) -> Structure:
    """Check an alignment of `register_rig`: the mean agreement, what biases the pose.

    Of too few pixels it says nothing. A pose that was predicted is one more that parts of the view may support.
    """

    def sample_at(T_world_body: SE3) -> Sample:
        return sample_images(images, T_world_body, alignment.light, params, motion).of_views(MIN_SAMPLES)

    def vote_at(T_world_body: SE3) -> Votes:
        return vote(images, params, sample_at(T_world_body))

    pose = alignment.T_world_camera
    sample, is_asked = sample_at(pose), Aspect.FIT in aspects
    found = Structure(_agreement(sample)) if is_asked else Structure()
    if is_asked and (found.agreement < SURE_AGREEMENT or alignment.ncc < SURE_NCC):
        support = find_support(vote_at, pose, T_predicted)
        found = replace(found, support=support, chance=support.chance)
    elif Aspect.PLACE in aspects:
        found = replace(found, chance=vote(images, params, sample).chance)
    if found.support.is_proven or Aspect.OCCLUSION not in aspects:
        return found
    return replace(found, occlusion=find_occlusion_bias(sample_at, sample, pose))


def _agreement(sample: Sample) -> float:
    """Return the mean cosine between the gradients, each pixel by how strong it is in the reference."""
    cosine, weight = cosines(sample)
    return float(weight @ cosine) / max(float(weight.sum()), TINY)
