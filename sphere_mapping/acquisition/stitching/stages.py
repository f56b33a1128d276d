"""Instants stitched in other processes: what a stitcher has learned of its rig goes with each of them.

A stitcher learns its lenses' falloff from its first instants and checks its rig once; from then on an instant depends
on nothing that was before. Until then the work stays where it is.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.spheres.sphere import Sphere


@dataclass(frozen=True, eq=False)
class StitchTask:
    """What was seen at an instant, as `Stitcher.stitch` takes it, and how the stitcher is made that stitches it."""

    recipe: bytes
    images: Mapping[str, NDArray[np.uint8]]
    stamp_ns: int
    points_rig: NDArray[np.floating[Any]] | None
    depths: Mapping[str, NDArray[np.floating[Any]]] | None


def recipe_of(stitcher: Stitcher) -> bytes:
    """Return how a stitcher that has learned its rig is made anew; ValueError where it still learns."""
    if not stitcher.is_settled:
        raise ValueError(f"rig {stitcher.rig.name}: expected a stitcher that has learned it, found one that learns")
    return pickle.dumps((stitcher.rig, stitcher.params, stitcher.masks, stitcher.learned))


def stitch(task: StitchTask) -> Sphere:
    """Return the sphere of an instant, the same bits as the stitcher itself would."""
    return _stitcher(task.recipe).stitch(task.images, task.stamp_ns, task.points_rig, task.depths).sphere


@lru_cache(maxsize=1)
def _stitcher(recipe: bytes) -> Stitcher:
    rig, params, masks, learned = pickle.loads(recipe)
    stitcher = Stitcher(rig, params, masks)
    stitcher.resume(learned)
    return stitcher
