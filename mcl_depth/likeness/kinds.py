"""How an image is compared with depth images: by gradients, or by what was learned. The map asks one of the two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mcl_depth.constants import CHANCE_SIGMA, MIN_SEEN
from mcl_depth.likeness.comparison import compare_gradients
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.encoder import EncoderPair, load_encoders
from mcl_depth.likeness.features import (
    GradientFeatures,
    Image,
    Mask,
    depth_features_many,
    visual_features,
)
from mcl_depth.likeness.gradient_filter import GradientFilter
from mcl_depth.likeness.learned import LearnedFilter, compare_learned, pack
from mcl_depth.likeness.spectra import Curves
from mcl_depth.params import FilterParams
from sphere_nav.geometry import Spherical

Visual = GradientFeatures | Image  # an image by gradients; what was learned of it (C, h, w), of length 1


@dataclass(frozen=True)
class Likeness:
    """One kind of features, and how they are made and compared."""

    name: str  # of what is kept on disk
    min_seen: float  # share of the panorama that an image must show
    chance_sigma: float  # of z where a drive is not, after any number of images (docs/notes/joint_evidence.md)
    filter: type[Any]  # of one image against every cell, `GradientFilter` or `LearnedFilter`
    image: Callable[[Image, Mask], Any]  # level panorama (H, W), what of it is seen -> Visual
    depths: Callable[[Image], Stack]  # range panoramas (M, H, W) in m
    compare: Callable[..., Curves]  # Visual, stack, slots (M,), number of headings -> similarities (M, headings)


def check_likeness(params: FilterParams) -> EncoderPair | None:
    """Return the encoders that the parameters ask for, None for gradients; ValueError where they do not fit."""
    if params.likeness.kind != "learned":
        return None
    encoders = load_encoders()
    if (found := params.synthesis.num_columns) != encoders.num_columns:
        expected = f"synthesis.num_columns {encoders.num_columns}"
        raise ValueError(f"likeness.kind learned: expected {expected}, found {found}")
    return encoders


def likeness_of(params: FilterParams, camera: Spherical) -> Likeness:
    """Return the likeness of the parameters for a window of the sphere."""
    encoders = check_likeness(params)
    if encoders is None:
        return Likeness(
            name="",
            min_seen=0.0,
            chance_sigma=CHANCE_SIGMA[0],
            filter=GradientFilter,
            image=visual_features,
            depths=lambda ranges_m: depth_features_many(ranges_m, params.comparison),
            compare=compare_gradients,
        )
    return Likeness(
        name=encoders.digest,
        min_seen=MIN_SEEN,
        chance_sigma=CHANCE_SIGMA[1],
        filter=LearnedFilter,
        image=lambda gray, is_seen: encoders.features_of_image(gray, is_seen, camera),
        depths=lambda ranges_m: pack(encoders.features_of_depths(ranges_m, camera)),
        compare=compare_learned,
    )
