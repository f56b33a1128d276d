"""Sphere against spheres: dense visual odometry (M15 section 3.5, eq. 11)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sphere_mapping.constants import MIN_NCC
from sphere_mapping.params import REGISTRATION
from sphere_nav.geometry import SE3
from sphere_nav.photometric import (
    Alignment,
    Pyramid,
    Reference,
    View,
    build_pyramid,
    evaluate,
    prepare_reference,
    register,
    register_rotation,
)
from sphere_nav.photometric.align.esm import GOOD, OUTLIERS
from sphere_nav.photometric.align.problem import image_overlap
from sphere_nav.spheres.appearance.features import Features, features_of_sphere
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.region import region_radius


@dataclass(frozen=True, eq=False)
class PreparedSphere:
    """A sphere with what alignment needs of it, made at first use and kept."""

    sphere: Sphere

    @property
    def is_whole(self) -> bool:
        """Whether it sees in every direction."""
        return self.sphere.camera.is_whole

    @cached_property
    def pyramid(self) -> Pyramid:
        """Its image from fine to coarse, for the current side: NaN where no camera saw."""
        sphere = self.sphere
        return build_pyramid(sphere.gray, sphere.camera, REGISTRATION.pyramid, sphere.is_seen)

    @cached_property
    def reference(self) -> Reference:
        """Its salient pixels with range, for the reference side."""
        return prepare_reference(self.sphere.gray, self.sphere.range_m, self.sphere.camera, REGISTRATION)

    @cached_property
    def coverage(self) -> float:
        """Overlap that it has with itself: the share of its image that has a range, as `align_sphere` counts it."""
        return image_overlap(self.pyramid.cameras, [self.at(SE3.identity())], SE3.identity())

    @cached_property
    def region_m(self) -> float:
        """How far a camera can be localized by it; 0 without range."""
        return region_radius(self.sphere)

    @cached_property
    def features(self) -> Features:
        """Its local features, by which it is recognized."""
        return features_of_sphere(self.sphere)

    @cached_property
    def fine_features(self) -> Features:
        """Its local features by which a motion is found."""
        return features_of_sphere(self.sphere, is_fine=True)

    @cached_property
    def median_range(self) -> float:
        """Median of its finite ranges in metres; +Inf where it has none."""
        finite = self.sphere.range_m[self.sphere.measured]
        return float(np.median(finite)) if finite.size else np.inf

    def at(self, T_world_sphere: SE3) -> View:
        """Return it as a reference at a pose."""
        return View(self.reference, T_world_sphere)


def align_sphere(
    current: PreparedSphere,
    references: Sequence[View],
    guesses: Iterable[SE3],
    check: Callable[[Alignment], str] = lambda _: GOOD,
) -> Alignment:
    """Align a sphere with references, from one guess of T_world_sphere after the other until one converges.

    Guesses are tried lazily, the most likely first; where none converges the result of the first is returned. A
    result whose images do not resemble each other, as when the lens is covered, is refused as OUTLIERS; one that
    looks good is refused for the reason that `check` gives, if any.
    """
    first: Alignment | None = None
    for T_world_sphere in guesses:
        alignment = register(current.pyramid, references, T_world_sphere, REGISTRATION)
        if alignment.is_converged and alignment.ncc < MIN_NCC:
            alignment = replace(alignment, reason=OUTLIERS)
        if alignment.is_converged:
            alignment = replace(alignment, reason=check(alignment))
        if alignment.is_converged:
            return alignment
        first = first or alignment
    assert first is not None
    return first


def guess_by_rotation(now: PreparedSphere, before: PreparedSphere, T_world_before: SE3) -> SE3:
    """Return the guess of T_world_now by the rotation between two images alone (eq. 20)."""
    if now.sphere.camera != before.sphere.camera:
        return T_world_before
    return T_world_before @ register_rotation(now.pyramid, before.pyramid, REGISTRATION)


def residual_at(current: PreparedSphere, reference: View, T_world_sphere: SE3) -> Alignment:
    """Return what `align_sphere` would report at a pose without moving it: MAD, overlap, correlation."""
    return evaluate(current.pyramid, [reference], T_world_sphere, REGISTRATION)
