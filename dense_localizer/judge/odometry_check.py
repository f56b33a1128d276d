"""Do the poses found in images agree with odometry? Late images and wrong places do not.

Odometry measures motions, not places. Two things follow from it: a place found after a loss must be where odometry says
the camera has gone since; and when the motion changes, it changes in the images at the same time. The delay between
both is estimated from how their motions differ, by the change of the motion with time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dense_localizer.constants import (
    COMPARISON_SIGMA,
    DELAY_SIGMAS,
    DISPUTE_S,
    IMAGE_FORGETTING,
    MAX_INNOVATION,
    MAX_POSITION_SIGMA_M,
    MIN_DELAY_S,
    MOTION_INTERVAL_S,
    MOTION_SHIFT_S,
)
from sphere_nav.estimation.least_squares import gate, squared_distance
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.odometry import PoseBuffer
from sphere_nav.localization.status import FINE, Reason, Verdict


@dataclass(frozen=True)
class OdometrySample:
    """One image: where it was placed, and where odometry was at its stamp."""

    stamp_ns: int
    T_map_camera: SE3
    covariance: Array
    T_odom_camera: SE3


class OdometryCheck:
    """Compares the poses of one drive with odometry."""

    def __init__(self, odometry_error: float) -> None:
        self._error = odometry_error  # as share of the motion
        self.reset()

    def reset(self) -> None:
        """Nothing is known: the stream or the map is another, or an operator has said where the camera is."""
        self._samples = PoseBuffer[OdometrySample]()  # odometry at the stamps of images
        self._placed: OdometrySample | None = None  # the last image, by all that was known
        self._trusted: OdometrySample | None = None
        self._driven = np.zeros(2)  # m and rad that odometry has driven since the last trusted place
        self._last_odom: SE3 | None = None
        self._is_trusted = self._is_new = False  # new: the last sample may become the trusted one
        self._information = self._score = 0.0
        self._dispute: tuple[Verdict, OdometrySample] | None = None  # what is said of it, the place that began it
        self._growth = np.zeros(6)  # of the covariance of odometry, when the dispute began
        self._compared_ns = 0

    def propagate(self, T_odom_camera: SE3 | None, *, is_trusted: bool) -> None:
        """Note odometry at the stamp of an image, placed or not; whether the last one placed is trusted."""
        if is_trusted and self._is_new:
            self._trusted, self._driven, self._is_new = self._placed, np.zeros(2), False
        self._is_trusted = is_trusted
        if T_odom_camera is not None and self._last_odom is not None:
            self._driven = self._driven + np.array(self._last_odom.distance(T_odom_camera))
        self._last_odom = T_odom_camera

    def start(self, sample: OdometrySample) -> bool:
        """Begin anew at a place found by a search; return whether odometry says that the camera has gone there."""
        self._samples.clear()
        self._is_new = False
        self._information = self._score = 0.0
        self._dispute = None
        self._check_place(sample)
        if self._trusted is None or self._error * self._driven[0] > MAX_POSITION_SIGMA_M:
            return False
        return self._distance(self._trusted, sample) <= gate(6)

    def _check_place(self, sample: OdometrySample, *, defies_odometry: bool = False) -> None:
        """Dispute a place that is not where odometry says the camera has gone since it was last sure.

        Until one is there again, as nearly as odometry knew when the dispute began: it knows less with every metre; and
        nearer than to the disputed place: an image that is not sure is near to both. A place that defies odometry was
        refused where odometry expected it: it need not be as far off as others.
        """
        if self._trusted is None:
            return
        if self._dispute is not None:
            told = self._placed or sample
            squared = self._distance(self._trusted, told)
            if squared <= gate(6) and squared < self._distance(self._dispute[1], told):
                self._dispute = None
            return
        self._growth = np.repeat(self._error * self._driven, 3) ** 2 + COMPARISON_SIGMA**2
        sigmas = float(np.sqrt(self._distance(self._trusted, sample)))
        limit = float(np.sqrt(gate(6))) if defies_odometry else MAX_INNOVATION
        if sigmas > limit:
            detail = "standard deviations from where odometry says the camera has gone since it was last sure"
            self._dispute = Verdict(Reason.ODOM_STALE, sigmas, limit, detail), sample

    def _distance(self, before: OdometrySample, sample: OdometrySample) -> float:
        """Return how far a place is from where odometry says the camera has gone since another one, squared."""
        T_map_camera = before.T_map_camera @ before.T_odom_camera.inverse() @ sample.T_odom_camera
        covariance = before.covariance + sample.covariance + np.diag(self._growth)
        return squared_distance(T_map_camera, sample.T_map_camera, covariance)

    def find(
        self, sample: OdometrySample, placed: OdometrySample | None = None, *, defies_odometry: bool = False
    ) -> Verdict:
        """Note an image that was placed; return how odometry contradicts it.

        `sample`: by the image alone; `placed`: with its prediction, in which odometry may be.
        """
        self._placed = placed or sample
        if self._dispute is not None and sample.stamp_ns - self._dispute[1].stamp_ns > DISPUTE_S * 1e9:
            self._dispute = self._trusted = None  # it has held for long
        elif self._dispute is not None or defies_odometry or not self._is_trusted:
            self._check_place(sample, defies_odometry=defies_odometry)
        if self._dispute is not None:  # how a wrong place moves says nothing of a delay
            self._is_new = False
            return self._dispute[0]
        self._samples.append((sample.stamp_ns, sample.T_odom_camera, sample))
        while self._samples and sample.stamp_ns - self._samples[0][0] > (MOTION_INTERVAL_S + 2 * MOTION_SHIFT_S) * 1e9:
            self._samples.popleft()
        if sample.stamp_ns - self._compared_ns >= MOTION_INTERVAL_S * 1e9:
            self._compare(sample)
        finding = self._find_delay()
        self._is_new = finding is FINE
        return finding

    def _find_delay(self) -> Verdict:
        """Return the delay where it is surely one."""
        if self._information <= 0.0:
            return FINE
        delay, sigma = self._score / self._information, self._information**-0.5
        if abs(delay) - DELAY_SIGMAS * sigma < MIN_DELAY_S:
            return FINE
        late = "images late against odometry" if delay > 0 else "odometry late against images"
        detail = f"s, {late}, +- {sigma:.2g}"
        return Verdict(Reason.ODOM_STALE, abs(delay), MIN_DELAY_S, detail, "check the stamps of camera and odometry")

    def _compare(self, now: OdometrySample) -> None:
        """Compare the motions over the last interval; add what they show of the delay."""
        first = next(
            (one for _, _, one in self._samples if now.stamp_ns - one.stamp_ns <= (MOTION_INTERVAL_S + 0.02) * 1e9), now
        )
        shift_ns = int(MOTION_SHIFT_S * 1e9)
        ends = [self._samples.at(one.stamp_ns - shift_ns) for one in (first, now)]
        if first is now or ends[0] is None or ends[1] is None:
            return
        self._compared_ns = now.stamp_ns
        T_odometry = first.T_odom_camera.inverse() @ now.T_odom_camera
        T_images = first.T_map_camera.inverse() @ now.T_map_camera
        residual = (T_odometry.inverse() @ T_images).log()
        change = (T_odometry.inverse() @ ends[0][0].inverse() @ ends[1][0]).log() / MOTION_SHIFT_S
        meters, radians = first.T_odom_camera.distance(now.T_odom_camera)
        sigma = np.hypot(np.repeat([self._error * meters, self._error * radians], 3), COMPARISON_SIGMA)
        weight = 1.0 / (sigma**2 + np.diagonal(first.covariance) + np.diagonal(now.covariance))
        self._information = IMAGE_FORGETTING * self._information + float(change @ (weight * change))
        self._score = IMAGE_FORGETTING * self._score + float(change @ (weight * residual))
