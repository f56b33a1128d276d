"""Is the lens the one that camera_info tells? What images near key spheres say together, and what it does to a pose.

Where the map is wrong about its ranges an image is wrong about its lens, and the next one is in the same way. So each
key sphere errs by itself, however many images it places, and how differently key spheres tell it counts.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dense_localizer.constants import (
    CORRELATED_CELLS,
    INTEGRITY_PERIOD,
    LENS_NOISE,
    LENS_PIXELS,
    LENS_SIGMAS,
    LENS_SPHERES,
    MAX_SHARE,
)
from dense_localizer.judge.candidate import PoseCandidate
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.localization.status import FINE, Reason, State, Verdict
from sphere_nav.photometric import RegistrationParams
from sphere_nav.photometric.checks.lens import Steps, Stretch, find_stretches

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

    def observe(self, candidate: PoseCandidate, params: RegistrationParams, state: State) -> Verdict:
        """Ask one of several images that the map has placed, each of a pose on probation until a lens is wrong.

        Where a lens is thought to be far off, the next image goes on from there; a pose on probation waits for that.
        Return what is against a lens.
        """
        self._num_left -= 1
        is_due = self._num_left <= 0 or (state is State.PROBATION and self.finding is FINE)
        if not is_due or candidate.alignment is None or candidate.is_by_range:
            return self.finding
        how = candidate.alignment, params, candidate.motion, self._longer
        found, self._longer = find_stretches(candidate.images, *how, is_clear=not candidate.is_biased)
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
