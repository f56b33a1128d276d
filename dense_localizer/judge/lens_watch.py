"""What is wrong with a camera: is its lens the one that camera_info tells, and what is before it?

What images near key spheres say together of the lens, and what it does to a pose (`LensWatch`): where the map is wrong
about its ranges an image is wrong about its lens, and the next one is in the same way. So each key sphere errs by
itself, however many images it places, and how differently key spheres tell it counts.

Which parts of an image never show the map while the vehicle moves: dirt on the lens, the own bonnet, a bracket
(`ViewMask`). What a cell of the image shows changes as the vehicle moves; what is before the lens stays as it is. So
each cell collects log-odds over images between which the view has moved: do its gradients disagree with the map, and
are they those of the image before? Changed scenery does the one, a road ahead the other. Cells that surely do both are
left out of what is aligned. They are asked on, by the image as it was, so that a lens which was wiped sees again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    CORRELATED_CELLS,
    HIDDEN_LOG_ODDS,
    INTEGRITY_PERIOD,
    LENS_FAR,
    LENS_NOISE,
    LENS_PIXELS,
    LENS_SIGMAS,
    LENS_SPHERES,
    LOG_ODDS_HIDDEN,
    LOG_ODDS_RANGE,
    LOG_ODDS_SEEN,
    MASK_CELLS,
    MASK_COSINE,
    MASK_STEP_RAD,
    MAX_SHARE,
    MIN_MASK_PIXELS,
    NUM_KEPT,
)
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.references.reference import RigChoice
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.localization.status import FINE, Reason, State, Verdict
from sphere_nav.photometric import Pyramid, RegistrationParams
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.lens import Steps, Stretch, find_stretches
from sphere_nav.photometric.constants import MIN_COSINE_RATIO
from sphere_nav.photometric.pixels.pyramid import hide
from sphere_nav.photometric.pixels.samples import cosines_by_cell, sample_images

ADVICE = "calibrate the camera, or run sphere_nav refine-camera"
OPEN = Verdict(Reason.BAD_INFO, detail="the lens may be another one than camera_info says", advice=ADVICE)


class LensWatch:
    """Keeps what the latest key spheres tell of each camera; one lens is wrong as long as the stream lasts.

    finding: what is against a lens; covariance (6, 6): of the pose, by what its lenses do to it.
    """

    def __init__(self, pixels_per_radian: float = np.inf) -> None:
        """`pixels_per_radian`: of the map, which shows no lens more exactly."""
        self._limit = max(MAX_SHARE, LENS_PIXELS / pixels_per_radian)
        self.reset()

    def reset(self) -> None:
        """Forget all: it may be another camera_info."""
        self.finding: Verdict = FINE
        self.covariance: Array = np.zeros((6, 6))
        self._told: dict[str, dict[int, Array]] = {}  # information and information times share, of a key sphere
        self._judged: dict[str, tuple[Verdict, Array]] = {}  # finding and covariance of each camera
        self._longer: Steps = {}  # what is thought of a lens that is far off
        self._num_left = 0  # images that are not asked
        self._far = LENS_FAR  # steps by which the lens of the next image is tried to be longer

    def observe(self, candidate: PoseCandidate, params: RegistrationParams, state: State) -> Verdict:
        """Ask one of several images that the map has placed, each of a pose on probation until a lens is wrong.

        Where a lens is thought to be far off, the next image goes on from there; a pose on probation waits for that.
        Return what is against a lens.
        """
        self._num_left -= 1
        is_due = self._num_left <= 0 or (state is State.PROBATION and self.finding is FINE)
        if not is_due or candidate.alignment is None or candidate.is_by_range:
            return self.finding
        self._far = -self._far
        how = candidate.alignment, params, candidate.motion, self._longer
        found, self._longer = find_stretches(candidate.images, *how, far=self._far, is_clear=not candidate.is_biased)
        is_open = bool(self._longer and not found)
        self._num_left = 0 if is_open else INTEGRITY_PERIOD
        self.add(found, candidate.choice.ids[0])
        return OPEN if is_open and state is State.PROBATION and self.finding is FINE else self.finding

    def add(self, stretches: Iterable[Stretch], sphere_id: int) -> None:
        """Take what an image tells that was placed by a key sphere, and judge."""
        for one in stretches:
            told = self._told.setdefault(one.camera, {})
            information = 1.0 / max(CORRELATED_CELLS * one.sigma**2, TINY)
            told[sphere_id] = told.pop(sphere_id, np.zeros(2)) + information * np.array([1.0, one.share])
            if len(told) > LENS_SPHERES:
                del told[next(iter(told))]
            share, sigma = fuse(np.array(list(told.values())))
            is_wrong = abs(share) > max(LENS_SIGMAS * sigma, self._limit)
            covariance = max(share**2 - sigma**2, 0.0) * np.outer(one.by_share, one.by_share)
            self._judged[one.camera] = _name(one.camera, share, sigma, self._limit) if is_wrong else FINE, covariance
        self.finding = next((finding for finding, _ in self._judged.values() if finding.reason), FINE)
        self.covariance = sum((covariance for _, covariance in self._judged.values()), np.zeros((6, 6)))


def fuse(told: Array) -> tuple[float, float]:
    """Return the share that key spheres (N, 2) tell together, and its deviation, wider where they scatter more."""
    weight = 1.0 / (1.0 / told[:, 0] + LENS_NOISE**2)
    shares = told[:, 1] / told[:, 0]
    share = float(np.average(shares, weights=weight))
    spread = float(weight @ (shares - share) ** 2) / max(len(told) - 1, 1)
    return share, float(np.sqrt(max(spread, 1.0) / np.sum(weight)))


def _name(camera: str, share: float, sigma: float, limit: float) -> Verdict:
    """Return what is told of a lens that is wrong."""
    of = f" of camera {camera}" if camera else ""
    size = f"{100.0 * abs(share):.1f} ± {100.0 * sigma:.1f} % {'longer' if share > 0.0 else 'shorter'}"
    detail = f"the lens{of} is {size} than camera_info says"
    return Verdict(Reason.BAD_INFO, abs(share), limit, detail, ADVICE)


COLUMNS, ROWS = MASK_CELLS
Cells = NDArray[np.bool_]  # (ROWS, COLUMNS)
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
        asked = found.known & (found.typical >= MASK_COSINE)
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
    return np.asarray(both > MASK_COSINE * np.sqrt(squares[0] * squares[1]))
