"""A map without what drives have rejected again and again."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dense_localizer.references.rejections import Rejections
from sphere_nav.ros.maps.reader import MapDetails, MapReader, Progress, save_map
from sphere_nav.spheres.sphere import Sphere


def together(parts: list[Rejections]) -> Rejections:
    """Return what several drives have counted."""
    counts: dict[int, NDArray[np.int64]] = {}
    for part in parts:
        for sphere_id, count in part.counts.items():
            counts[sphere_id] = counts.get(sphere_id, np.zeros_like(count)) + count
    return Rejections(counts)


def save_without(reader: MapReader, rejections: Rejections, target: Path, progress: Progress) -> None:
    """Write a map of one without the range of what is forgotten."""
    info = reader.info
    details = MapDetails(
        source=f"{info.source} without rejections",
        parameters=reader.parameters,
        rig=info.rig,
        frame_id=info.header.frame_id,
    )
    load, appearance = partial(_load, reader, rejections), reader.appearance()
    save_map(target, reader.graph, details, load_sphere=load, appearance=appearance, progress=progress)


def without(sphere: Sphere, rejections: Rejections, sphere_id: int) -> Sphere:
    """Return a key sphere without range where it is forgotten."""
    unused = rejections.mask(sphere_id, sphere.camera)
    if unused is None:
        return sphere
    nan, std_m = np.float32(np.nan), sphere.range_std_m
    left = None if std_m is None else np.where(unused, nan, std_m)
    filled = None if sphere.is_filled is None else sphere.is_filled & ~unused
    return replace(sphere, range_m=np.where(unused, nan, sphere.range_m), range_std_m=left, is_filled=filled)


def _load(reader: MapReader, rejections: Rejections, sphere_id: int) -> Sphere:
    return without(reader.load_sphere(sphere_id), rejections, sphere_id)
