"""Where grey levels do not place an image, geometry does: the depth of the instant against the map's own ranges.

It knows no light: by night with a lamp of its own the vehicle goes on in a map of the day. An image that the map places
well needs none of it. One that is placed with care is joined with it by their covariances; where they contradict each
other geometry holds, as it does alone for one that is refused: if both ways fit and agree, all six directions are held,
and the prediction allows it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from dense_localizer.constants import NUM_KEPT
from dense_localizer.judge.candidate import PoseCandidate, assess_range
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from sphere_nav.estimation.least_squares import gate, squared_mahalanobis
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.range_alignment import DepthImage, RangeFit, RangeImage, measure_motion_by_ranges


class RangeSupport:
    """Places depth images among the ranges of the key spheres of one map."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references, self._params = references, params
        self._range_of = lru_cache(NUM_KEPT)(lambda one: RangeImage.from_sphere(references.coarse.load(one)))
        self._range_of_depth = lru_cache(1)(RangeImage.from_depth)  # several predictions of one instant ask for it

    def support(self, depth: DepthImage, candidate: PoseCandidate) -> PoseCandidate:
        """Return a candidate with what the depth of its instant adds; as it is where that is nothing.

        A guess of the whole map gets none: rooms that look different are the same to range.
        """
        prediction = candidate.prediction
        is_anywhere = prediction.is_guess and not prediction.is_near
        if candidate.acceptance.is_good or is_anywhere:
            return candidate
        found = self._place(depth, prediction.T_map_camera)
        if found is None:
            return candidate
        fit, T_map_body, covariance = found
        acceptance = assess_range(fit, T_map_body, covariance, prediction, self._params.acceptance)
        if not (acceptance.is_good or (acceptance.is_accepted and not candidate.is_accepted)):
            return candidate
        supported = replace(candidate, acceptance=acceptance)
        if candidate.is_accepted:
            T, joint, apart = join(candidate.T_map_camera, candidate.covariance, T_map_body, covariance)
            if apart**2 <= gate(6):
                return replace(supported, T_map_camera=T, covariance=joint)
        return replace(supported, T_map_camera=T_map_body, covariance=covariance, is_by_range=True)

    def _place(self, depth: DepthImage, T_map_body: SE3) -> tuple[RangeFit, SE3, Array] | None:
        """Return the best fit of depth near a pose, the pose of the body T_map_body by it and its covariance (6, 6)."""
        T_body_depth = depth.T_image_depth
        T_map_depth = T_map_body @ T_body_depth
        image = self._range_of_depth(depth)
        best: tuple[RangeFit, SE3, Array] | None = None
        for node in self._references.covering(T_map_depth, image.camera, self._params.reference.num_references):
            T_guess = node.T_map_sphere.inverse() @ T_map_depth
            fit = measure_motion_by_ranges(self._range_of(node.id), image, T_guess)
            if fit is None or (best is not None and fit.likeness <= best[0].likeness):
                continue
            by_map = self._references.error.covariance(node.id, fit.T_a_b)
            Ad = T_body_depth.adjoint()
            T_map_found = SE3.exp((node.T_map_sphere @ fit.T_a_b @ T_body_depth.inverse()).log())  # a rotation again
            best = fit, T_map_found, Ad @ (fit.covariance + by_map) @ Ad.T
        return best


def join(T_a: SE3, covariance_a: Array, T_b: SE3, covariance_b: Array) -> tuple[SE3, Array, float]:
    """Return the pose that two independent ones say, its covariance (6, 6), and how many deviations these are apart."""
    xi = (T_a.inverse() @ T_b).log()
    gain = covariance_a @ np.linalg.inv(covariance_a + covariance_b)
    joint = (np.eye(6) - gain) @ covariance_a
    apart = float(np.sqrt(squared_mahalanobis(xi, covariance_a + covariance_b)))
    return T_a @ SE3.exp(gain @ xi), 0.5 * (joint + joint.T), apart
