"""Likeness as it was learned: two small convolutional networks, of images and of depth images, correlated over azimuth.

What an edge of depth looks like in a photograph is learned from pairs that the simulator draws
(`benchmarks/likeness/train.py` of commit 76c5c3cb), where eq. 2 of N17 takes every gradient for one. Both networks are
convolutions with columns that wrap around, so a turned panorama has turned features, which are alike where the two fit.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from mcl_depth.constants import (
    CHANCE,
    CHANCE_SCALE,
    ENCODED_RANGE_M,
    IMAGE_CLIP,
    LCN_COLUMNS,
    MIN_CONTRAST_LEVELS,
    MIN_SEEN,
    NUM_FREQUENCIES,
)
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.features import Image, Mask, fill_unknown, normalize_contrast
from mcl_depth.likeness.spectra import Curves, best_around, correlate, encode, spectra_of
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays

WEIGHTS = Path(__file__).with_name("weights.npz")


@dataclass(frozen=True, eq=False)
class Encoder:
    """A chain of convolutions, each but the last followed by max(x, 0).

    table (L, 6) int64, one row a layer: inputs, outputs, rows and columns of the filter, strides over rows and columns.
    values: weights (outputs, inputs, rows, columns), then biases (outputs,), layer by layer.
    """

    table: NDArray[np.int64]
    values: Image

    def __call__(self, inputs: Image) -> Image:
        """Return the features (M, C, h, w) of inputs (M, n, H, W)."""
        return np.stack([self._encode(one) for one in inputs])

    def _encode(self, image: Image) -> Image:
        """Return the features (C, h, w) of an input (n, H, W): columns wrap around, above and below it is 0."""
        values = self.values
        for layer, (inputs, outputs, height, width, *strides) in enumerate(self.table.tolist()):
            weights, values = np.split(values, [outputs * inputs * height * width])
            biases, values = np.split(values, [outputs])
            around = np.pad(image, ((0, 0), (0, 0), (width // 2, width // 2)), "wrap")
            around = np.pad(around, ((0, 0), (height // 2, height // 2), (0, 0)))
            windows = sliding_window_view(around, (height, width), axis=(1, 2))[:, :: strides[0], :: strides[1]]
            shaped = weights.reshape(outputs, inputs, height, width)
            image = np.tensordot(shaped, windows, ((1, 2, 3), (0, 3, 4))) + biases[:, None, None]
            image = np.maximum(image, np.float32(0.0)) if layer < len(self.table) - 1 else image
        return image


class EncoderPair(NamedTuple):
    """The encoders, for which panoramas they were trained, and what their weights hash to."""

    image: Encoder
    depth: Encoder
    num_columns: int
    digest: str


@cache
def load_encoders() -> EncoderPair:
    """Return the encoders of the package."""
    with np.load(WEIGHTS, allow_pickle=False) as file:
        image, depth = (Encoder(file[f"{side}_table"], file[f"{side}_values"]) for side in ("image", "depth"))
        return EncoderPair(image, depth, int(file["num_columns"]), hashlib.sha256(WEIGHTS.read_bytes()).hexdigest())


class Learned:
    """The likeness of whole panoramas in homes, one for each place and for all cells of a map."""

    min_seen = MIN_SEEN
    chance_scale = CHANCE_SCALE[1]

    def __init__(self, camera: Spherical) -> None:
        self._camera, self._encoders = camera, load_encoders()
        self.name = self._encoders.digest

    def image(self, gray: Image, is_seen: Mask) -> Image:
        """Return the features (C, h, w) of a level panorama (H, W) of grey levels, of length 1."""
        return normalize(self._encoders.image(image_inputs(gray, is_seen, self._camera)[None]))[0]

    def depth_features(self, ranges_m: Image) -> Image:
        """Return the features (M, C, h, w) of range panoramas (M, H, W) in m, of length 1."""
        return normalize(self._encoders.depth(depth_inputs(ranges_m, self._camera)))

    def depths(self, ranges_m: Image) -> Stack:
        """Return their spectra in bytes."""
        codes, scales = encode(spectra_of(self.depth_features(ranges_m)))
        return {"codes": codes, "scales": scales}

    def compare(self, visual: Image, stack: Stack, slots: NDArray[np.int64], num_headings: int) -> Curves:
        """Return the similarity (M, num_headings) of features (C, h, w), by chance that of eq. 2."""
        return (CHANCE + self.survey(visual, stack, slots, num_headings)).astype(np.float32)

    def survey(self, visual: Image, stack: Stack, slots: NDArray[np.int64], num_headings: int) -> Curves:
        """Return the correlation of features (C, h, w) with cells in `slots` (M,), -1 fits nothing: (M, num_headings).

        Headings as those of eq. 2, the best around each.
        """
        curves = correlate(stack["codes"], stack["scales"], slots, spectra_of(visual), num_headings)
        return best_around(curves / np.float32(visual.shape[-1]))


def image_inputs(gray: Image, is_seen: Mask, camera: Spherical) -> Image:
    """Return what the encoder of images takes of a level panorama (H, W) of grey levels, (n, H, W).

    Its contrast, normalized over two neighbourhoods, and the sine of the elevation; what is not seen has no contrast.
    """
    gray = fill_unknown(np.where(is_seen, gray, np.nan).astype(np.float32))
    width = camera.full_width
    parts = []
    for share in LCN_COLUMNS:
        contrast = normalize_contrast(gray, max(round(share * width), 1), MIN_CONTRAST_LEVELS)
        parts.append(np.where(is_seen, np.clip(contrast, -IMAGE_CLIP, IMAGE_CLIP), np.float32(0.0)))
    return np.stack([*parts, sine_of_elevation(camera)]).astype(np.float32)


def depth_inputs(ranges_m: Image, camera: Spherical) -> Image:
    """Return what the encoder of depths takes of range panoramas (M, H, W) in m, NaN unknown, (M, 4, H, W).

    Logarithm and inverse of the range, 0 where it is unknown, 1 where it is known, and the sine of the elevation.
    """
    ranges_m = np.asarray(ranges_m, np.float32)
    low, high = ENCODED_RANGE_M
    is_known = ~np.isnan(ranges_m)
    bounded = np.where(is_known, np.clip(ranges_m, low, high), np.float32(1.0))
    elevations = np.broadcast_to(sine_of_elevation(camera), ranges_m.shape)
    known = is_known.astype(np.float32)
    return np.stack([known * (np.log(bounded) - np.float32(1.0)), known / bounded, known, elevations], axis=1)


def normalize(features: Image) -> Image:
    """Return features (M, C, h, w) less what is too fine over azimuth, and the mean of each row; of length 1 each."""
    spectra = scipy.fft.rfft(features, axis=-1)
    spectra[..., 0] = spectra[..., NUM_FREQUENCIES:] = 0.0
    local = scipy.fft.irfft(spectra, features.shape[-1], axis=-1)
    lengths = np.sqrt(np.sum(local**2, axis=(1, 2, 3), keepdims=True))
    normalized: Image = (local / np.maximum(lengths, np.float32(1e-9))).astype(np.float32)
    return normalized


@lru_cache(maxsize=4)
def sine_of_elevation(camera: Spherical) -> Image:
    """Return the sine of the elevation of every pixel (H, W)."""
    return np.ascontiguousarray(pixel_rays(camera)[..., 2], np.float32)
