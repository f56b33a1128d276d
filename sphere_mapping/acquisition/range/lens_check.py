"""Whether cameras have the lenses of the rig file: told by their `camera_info`, and by what their images share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from sphere_mapping.acquisition.constants import (
    CLOSENESS,
    FIT_DEG,
    INFO_TOLERANCE,
    LENS_FEATURES,
    LENS_SIDE,
    MAX_RAYS_DEG,
    MIN_MATCHES,
    MIN_SHARED_VIEW,
    OTHER_CAMERAS,
    OTHER_DISTORTIONS,
    OTHER_LENS,
    OUTLINE_RAYS,
)
from sphere_mapping.acquisition.range.rectification import Matches, find_features, pair_descriptors, rays_of
from sphere_mapping.acquisition.range.semi_global import shrink
from sphere_mapping.acquisition.range.sweep_tables import shared_view
from sphere_nav.geometry import Camera, Fisheye, Pinhole, Rig
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats

MODELS: dict[str, type[Pinhole] | type[Fisheye]] = {"pinhole": Pinhole, "fisheye": Fisheye}  # that images may have


def check_info(name: str, ours: Camera, theirs: Camera) -> None:
    """Raise ValueError if a camera's own calibration is of another size, focal length or lens than the rig's."""
    if (theirs.width, theirs.height) != (ours.width, ours.height):
        found = f"found {theirs.width} x {theirs.height}"
        raise ValueError(f"{name}: size: expected {ours.width} x {ours.height} (rig file), {found}")
    if ours.model not in MODELS:
        return  # camera_info has no such model: what it says is an approximation
    fx, own_fx = float(ours.coefficients[0]), float(theirs.coefficients[0])
    if abs(own_fx - fx) > INFO_TOLERANCE * fx:
        raise ValueError(f"{name}: K[0]: expected {fx:.3f} (rig file), found {own_fx:.3f}")
    has_distortion = not isinstance(theirs, Pinhole) or theirs.is_distorted
    angle_deg = _angle_between(ours, theirs)
    if has_distortion and not angle_deg <= MAX_RAYS_DEG:  # without: what drivers say of any lens
        found = f"{theirs.model} whose rays differ by {angle_deg:.1f} deg"
        raise ValueError(f"{name}: lens: expected {ours.model} (rig file), found {found}")


def _angle_between(ours: Camera, theirs: Camera) -> float:
    """Return the median angle in degrees between the rays of two calibrations of one image."""
    u, v = np.meshgrid(np.linspace(0, ours.width - 1, OUTLINE_RAYS), np.linspace(0, ours.height - 1, OUTLINE_RAYS))
    rays = [camera.unproject(np.stack([u, v], axis=-1)) for camera in (ours, theirs)]
    cosine = np.sum(rays[0] * rays[1], axis=-1)
    return float(np.degrees(np.arccos(np.clip(np.nanmedian(cosine), -1.0, 1.0))))


def why_other_lens(num: int, given: float, other: float, lens: str) -> str:
    """Return what the images are of, if not of what the rig file says; empty: of that, or nobody knows.

    Of `num` common features the share `given` fits the rig file, and `other` the other lens that fits best.
    """
    (share, factor), (many, least) = OTHER_LENS, OTHER_CAMERAS
    if other > share and other > factor * given:
        return f"a {lens}: {other:.0%} of {num} common features fit it, {given:.0%} the rig file"
    if num >= many and given < least:
        return f"other cameras: {given:.0%} of {num} common features fit the rig file"
    return ""


def check_lenses(rig: Rig, images: Mapping[str, Bytes]) -> None:
    """Raise ValueError if what the grey images (h, w) share fits another lens model much better than the rig file's.

    Neighbours that look different ways see the same things by different parts of their lenses; the same focal length
    read as another model puts these things elsewhere. Cameras without common features say nothing.
    """
    others = _other_lenses(rig)
    rigs = (rig, *others.values())
    pairs = [
        (a, b)
        for a, b in combinations(images, 2)
        if any(shared_view(one.camera(a), one.camera(b)) >= MIN_SHARED_VIEW for one in rigs)
    ]
    matches = _match_all(images, pairs)
    num = sum(len(one.pixels_first) for one in matches)
    if num < MIN_MATCHES:
        return
    shares = {lens: _share_that_fits(other, matches) for lens, other in others.items()}
    name, k1 = max(shares, key=lambda lens: shares[lens])
    lens = f"{name} of distortion {k1}" if k1 else name
    if reason := why_other_lens(num, _share_that_fits(rig, matches), shares[name, k1], lens):
        models = ", ".join(sorted({part.camera.model for part in rig.cameras}))
        raise ValueError(f"rig {rig.name}: lens: expected {models} (rig file), found images of {reason}")


def _other_lenses(rig: Rig) -> dict[tuple[str, float], Rig]:
    """Return the rig with each other plain lens of the same focal length and centre, by model and distortion."""
    found = {}
    for name, model in MODELS.items():
        for k1 in OTHER_DISTORTIONS[name]:
            parts = [replace(part, camera=_read_as(part.camera, model, k1)) for part in rig.cameras]
            found[name, k1] = replace(rig, cameras=tuple(parts))
    return found


def _read_as(camera: Camera, model: type[Pinhole] | type[Fisheye], k1: float) -> Camera:
    fx, fy, cx, cy = (float(value) for value in camera.coefficients[:4])
    return model(camera.width, camera.height, fx, fy, cx, cy, (k1, 0.0, 0.0, 0.0))


def _match_all(images: Mapping[str, Bytes], pairs_of_cameras: Sequence[tuple[str, str]]) -> list[Matches]:
    found = {name: _features(image) for name, image in images.items()}
    matches = []
    for a, b in pairs_of_cameras:
        first, second = pair_descriptors(found[a][1], found[b][1])
        matches.append(Matches(a, b, found[a][0][first], found[b][0][second]))
    return matches


def _features(image: Bytes) -> tuple[Array, Floats]:
    small, factor = shrink(image, LENS_SIDE)
    pixels, descriptors = find_features(small, nfeatures=LENS_FEATURES)
    return (pixels + 0.5) * factor - 0.5, descriptors


def _share_that_fits(rig: Rig, matches: list[Matches]) -> float:
    """Return the share of all matches that two cameras may see so, of a point at some range."""
    return float(np.mean(np.concatenate([_fits(*rays_of(rig, one)) for one in matches])))


def _fits(x: Array, y: Array, along: Array) -> Flags:
    seen = x - CLOSENESS[:, None, None] * along  # (K, N, 3), the point by its range, for ranges from far to nearest
    seen = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
    nearest = np.max(np.sum(seen * y, axis=-1), axis=0)
    return np.nan_to_num(nearest, nan=-1.0) > np.cos(np.radians(FIT_DEG))
