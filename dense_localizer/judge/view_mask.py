"""Which parts of an image never show the map while the vehicle moves: dirt on the lens, the own bonnet, a bracket.

What a cell of the image shows changes as the vehicle moves; what is before the lens stays as it is. So each cell
collects log-odds over images between which the view has moved: do its gradients disagree with the map, and are they
those of the image before? Changed scenery does the one, a road ahead the other. Cells that surely do both are left out
of what is aligned. They are asked on, by the image as it was, so that a lens which was wiped sees again.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    HIDDEN_LOG_ODDS,
    LOG_ODDS_HIDDEN,
    LOG_ODDS_RANGE,
    LOG_ODDS_SEEN,
    MASK_CELLS,
    MASK_STEP_RAD,
    MIN_MASK_COSINE,
    MIN_MASK_PIXELS,
    MIN_STILL_COSINE,
)
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.references.reference import RigChoice
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Pyramid, RegistrationParams
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.constants import MIN_COSINE_RATIO
from sphere_nav.photometric.pixels.pyramid import hide
from sphere_nav.photometric.pixels.samples import cosines_by_cell, sample_images

COLUMNS, ROWS = MASK_CELLS
Cells = NDArray[np.bool_]  # (ROWS, COLUMNS)
NUM_KEPT = 16  # latest images that are kept without their hidden cells: several cameras, by grey levels and contrast
PIXELS_PER_CELL = 8  # of the level whose gradients are compared with those of the image before


class ViewMask:
    """The log-odds (ROWS, COLUMNS) of each camera's cells that they show the world, by the camera's name."""

    def __init__(self, params: RegistrationParams) -> None:
        self._params = params
        self._without_hidden = lru_cache(NUM_KEPT)(self._hide_cells)
        self.reset()

    def reset(self) -> None:
        """Nothing is known of any camera."""
        self._log_odds: dict[str, Array] = {}
        self._gradients: dict[str, Array] = {}  # when last asked
        self._last: SE3 | None = None  # T_map_body when last asked

    def hidden(self, name: str) -> Cells:
        """Return which cells of a camera are left out: those that surely never show the map, and gaps among them."""
        surely = self._log_odds.get(name, np.zeros((ROWS, COLUMNS))) <= HIDDEN_LOG_ODDS
        return np.asarray(cv2.morphologyEx(surely.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3))) > 0)

    def hide(self, chosen: RigChoice) -> RigChoice:
        """Return the images that are to be aligned without the cells that are left out."""
        return replace(chosen, images=tuple(map(self._hide, chosen.images)))

    def _hide(self, image: RigImage) -> RigImage:
        return replace(image, pyramid=self._without_hidden(image.pyramid, image.name))

    def _hide_cells(self, pyramid: Pyramid, name: str) -> Pyramid:
        hidden = self.hidden(name)
        return hide(pyramid, hidden) if hidden.any() else pyramid

    def observe(self, candidate: PoseCandidate) -> None:
        """Ask the cells of images that the map has placed, once the view has moved since they were last asked."""
        alignment, pose = candidate.alignment, candidate.T_map_camera
        if alignment is None or candidate.is_by_range or not self._has_moved(pose, candidate.choice.typical_range_m):
            return
        self._last = pose
        images = [replace(one, pyramid=one.pyramid.whole or one.pyramid) for one in candidate.images]
        sample = sample_images(images, pose, alignment.light, self._params, candidate.motion)
        found = cosines_by_cell(sample, MASK_CELLS, MIN_MASK_PIXELS, len(images))
        disagree = found.mean < MIN_COSINE_RATIO * found.typical
        asked = found.known & (found.typical >= MIN_MASK_COSINE)
        cells = (one.reshape(-1, ROWS, COLUMNS) for one in (disagree, asked))
        for image, disagrees, is_asked in zip(images, *cells, strict=True):
            now, before = _gradients(image.pyramid), self._gradients.get(image.name)
            self._gradients[image.name] = now
            if before is not None and before.shape == now.shape:
                log_odds = self._log_odds.get(image.name, np.zeros((ROWS, COLUMNS)))
                votes = np.where(disagrees & _are_still(now, before), LOG_ODDS_HIDDEN, LOG_ODDS_SEEN)
                self._log_odds[image.name] = np.clip(log_odds + is_asked * votes, *LOG_ODDS_RANGE)

    def _has_moved(self, T_map_body: SE3, typical_range_m: float) -> bool:
        """Say whether most cells show something else than when they were last asked."""
        if self._last is None:
            return True
        xi = (self._last.inverse() @ T_map_body).log()
        return float(np.linalg.norm(xi[:3]) / typical_range_m + np.linalg.norm(xi[3:])) >= MASK_STEP_RAD


def _gradients(pyramid: Pyramid) -> Array:
    """Return the gradients (2, H, W) of the level at which a cell has about `PIXELS_PER_CELL` a side."""
    level = min(pyramid.levels, key=lambda one: abs(one.camera.width - PIXELS_PER_CELL * COLUMNS))
    return np.array(np.gradient(np.asarray(level.unpadded, np.float64)))


def _are_still(now: Array, before: Array) -> Cells:
    """Return which cells show the same gradients (2, H, W) at the same place in two images."""
    pairs = (now, before), (now, now), (before, before)
    both, *squares = (cv2.resize(np.sum(a * b, axis=0), MASK_CELLS, interpolation=cv2.INTER_AREA) for a, b in pairs)
    return np.asarray(both > MIN_STILL_COSINE * np.sqrt(squares[0] * squares[1]))
