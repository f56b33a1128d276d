"""How an image is compared with depth images: by gradients, or by what was learned. The map asks one of the two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MIN_SEEN
from mcl_depth.likeness import learned
from mcl_depth.likeness.comparison import similarity_many
from mcl_depth.likeness.encoder import EncoderPair, load_encoders
from mcl_depth.likeness.features import (
    FeatureStack,
    GradientFeatures,
    Image,
    Mask,
    depth_features_many,
    visual_features,
)
from mcl_depth.likeness.gradient_filter import GradientFilter
from mcl_depth.likeness.learned import LearnedFeatures, LearnedFilter, LearnedStack
from mcl_depth.likeness.spectra import Curves
from mcl_depth.params import FilterParams
from sphere_nav.geometry import Spherical

Visual = GradientFeatures | LearnedFeatures
SpectralFilter = GradientFilter | LearnedFilter


class GradientLikeness:
    """By gradients (N17 eq. 2)."""

    name, min_seen, filter = "", 0.0, GradientFilter

    def __init__(self, params: FilterParams, camera: Spherical) -> None:
        self._params, self._camera = params.comparison, camera

    def image(self, gray: Image, is_seen: Mask) -> GradientFeatures:
        """Return the gradients of a level panorama (H, W)."""
        return visual_features(gray, is_seen)

    def empty(self, capacity: int) -> FeatureStack:
        """Return room for so many panoramas."""
        return FeatureStack.empty(capacity, self._camera.height, self._camera.width)

    def depths(self, ranges_m: Image) -> FeatureStack:
        """Return the gradients of range panoramas (M, H, W) in m."""
        return depth_features_many(ranges_m, self._params)

    def similarities(
        self, visual: GradientFeatures, stack: FeatureStack, slots: NDArray[np.int64], num_headings: int
    ) -> Curves:
        """Return eq. 2 (M, num_headings)."""
        return similarity_many(visual, stack, num_headings, slots)


class LearnedLikeness:
    """By what was learned; for whole panoramas of the resolution of the training."""

    min_seen, filter = MIN_SEEN, LearnedFilter

    def __init__(self, encoders: EncoderPair, camera: Spherical) -> None:
        self.encoders, self._camera = encoders, camera
        self.name = encoders.digest

    def image(self, gray: Image, is_seen: Mask) -> LearnedFeatures:
        """Return the learned features of a level panorama (H, W)."""
        return LearnedFeatures(gray, None if is_seen.all() else is_seen, self.encoders, self._camera)

    def empty(self, capacity: int) -> LearnedStack:
        """Return room for so many panoramas."""
        return LearnedStack.empty(capacity, self.encoders, self._camera)

    def depths(self, ranges_m: Image) -> LearnedStack:
        """Return the learned features of range panoramas (M, H, W) in m."""
        return LearnedStack.of(self.encoders.features_of_depths(ranges_m, self._camera))

    def similarities(
        self, visual: LearnedFeatures, stack: LearnedStack, slots: NDArray[np.int64], num_headings: int
    ) -> Curves:
        """Return the learned similarity (M, num_headings)."""
        return learned.compare_learned(visual, stack.take(slots), num_headings)


def check_likeness(params: FilterParams) -> EncoderPair | None:
    """Return the encoders that the parameters ask for, None for gradients; ValueError where they do not fit."""
    if params.likeness.kind == "gradients":
        return None
    encoders = load_encoders()
    if (found := params.synthesis.num_columns) != encoders.num_columns:
        expected = f"synthesis.num_columns {encoders.num_columns}"
        raise ValueError(f"likeness.kind learned: expected {expected}, found {found}")
    return encoders


def likeness_of(params: FilterParams, camera: Spherical) -> GradientLikeness | LearnedLikeness:
    """Return the likeness of the parameters for a window of the sphere."""
    encoders = check_likeness(params)
    return GradientLikeness(params, camera) if encoders is None else LearnedLikeness(encoders, camera)
