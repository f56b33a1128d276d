"""Is the lens the one that camera_info tells? What the last images say together, and what it does to the pose.

One image can be wrong about its lens where the map is wrong about its ranges, and the next one is in the same way. So
each key sphere counts once, by its latest image; how differently they tell it says how sure they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dense_localizer.constants import ANOTHER_LENS, LENS_NOISE, LENS_PRIOR, LENS_SIGMAS, LENS_SPHERES, MAX_LENS_SHARE
from dense_localizer.judge.acceptance import Acceptance
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE, Finding, Reason
from sphere_nav.photometric.checks.lens import MEAN_PRODUCTS, LensError, mean_share


@dataclass(frozen=True, eq=False)
class LensVerdict:
    """What is against the lens, and the covariance (6, 6) of the pose by what is not known of it."""

    finding: Finding = FINE
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))

    def qualify(self, acceptance: Acceptance) -> Acceptance:
        """Return what a wrong lens leaves of an acceptance: care, whatever else there was to say."""
        if self.finding.reason is Reason.NONE:
            return acceptance
        return replace(acceptance, is_good=False, finding=self.finding, quality=min(acceptance.quality, 0.5))


class LensWatch:
    """Keeps what images of the last key spheres have told of each camera."""

    def __init__(self) -> None:
        self._told: dict[str, dict[int, LensError]] = {}

    def reset(self) -> None:
        """Forget them: it is another stream, or another camera_info."""
        self._told.clear()

    def add(self, errors: Iterable[LensError], sphere_id: int) -> None:
        """Take what an image tells that was placed by a key sphere."""
        for error in errors:
            self._told[error.name] = self._with(error, sphere_id)

    def judge(self, errors: Sequence[LensError], sphere_id: int) -> LensVerdict:
        """Return what the last images say, together with one that is not taken yet."""
        told = self._told | {error.name: self._with(error, sphere_id) for error in errors}
        verdicts = [_judge(list(one.values())) for one in told.values()]
        finding = next((one.finding for one in verdicts if one.finding.reason), FINE)
        return LensVerdict(finding, sum((one.covariance for one in verdicts), np.zeros((6, 6))))

    def _with(self, error: LensError, sphere_id: int) -> dict[int, LensError]:
        """Return what the key spheres tell, the latest last; this one alone where it tells of another lens."""
        told = {key: one for key, one in self._told.get(error.name, {}).items() if key != sphere_id}
        if told:
            share, covariance = _fuse(list(told.values()))
            both = covariance + error.covariance + np.diag(LENS_NOISE**2)
            if squared_mahalanobis(error.share - share, both) > ANOTHER_LENS**2:
                told = {}
        return dict([*told.items(), (sphere_id, error)][-LENS_SPHERES:])


def _fuse(told: Sequence[LensError]) -> tuple[Array, Array]:
    """Return the share (2,) that all tell together and its covariance (2, 2), wider where they scatter more."""
    information = [np.linalg.inv(one.covariance + np.diag(LENS_NOISE**2)) for one in told]
    covariance = np.linalg.inv(np.sum(information, axis=0))
    share = covariance @ np.sum([weight @ one.share for weight, one in zip(information, told, strict=True)], axis=0)
    square = sum(
        (one.share - share) @ weight @ (one.share - share) for weight, one in zip(information, told, strict=True)
    )
    return share, covariance * max(1.0, float(square) / max(2 * len(told) - 2, 1))


def _judge(told: Sequence[LensError]) -> LensVerdict:
    """Judge one camera; while its lens may be right, what calibrations are usually right to is known beside it."""
    share, covariance = _fuse(told)
    size = mean_share(share)
    along = MEAN_PRODUCTS @ share / max(size, 1e-12)
    finding, error = FINE, told[-1]
    if size > max(MAX_LENS_SHARE, LENS_SIGMAS * float(np.sqrt(along @ covariance @ along))):
        mean = float(share @ MEAN_PRODUCTS[0])
        camera, larger = f"camera {error.name}: " if error.name else "", "larger" if mean > 0 else "smaller"
        detail = f"{camera}the image is {abs(mean):.1%} {larger} about its centre than camera_info says"
        finding = Finding(Reason.LENS, mean, MAX_LENS_SHARE, detail)
    else:
        both = np.linalg.inv(np.linalg.inv(covariance) + np.diag(LENS_PRIOR**-2.0))
        share, covariance = both @ np.linalg.solve(covariance, share), both
    spread = covariance + np.outer(share, share)  # the pose is not corrected for it
    return LensVerdict(finding, error.by_share @ spread @ error.by_share.T)
