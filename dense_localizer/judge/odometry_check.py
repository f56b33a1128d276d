"""Do the poses found in images agree with odometry? Late images and wrong places do not.

Odometry tells motions, not places. Two things follow from it: a place found after a loss must be where odometry says
the camera has gone since; and when the motion changes, it changes in the images at the same time. The delay between
both is estimated from how their motions differ, by the change of the motion with time.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Finding, Reason

Array = NDArray[np.float64]
MAX_SIGMAS = 6.0  # of a place from where odometry says the camera is
SURE_SIGMAS = 5.0  # of the delay: by chance once in 3 million intervals
MIN_DELAY_S = 0.05  # a delay surely above it is told
DOUBT_S = 10.0  # a place that contradicts odometry must hold so long before it is trusted
INTERVAL_S = 0.5  # over which motions are compared
SHIFT_S = 0.1  # over which the change of a motion is measured
KEPT = 0.85  # weight of what earlier intervals told, from one to the next
MIN_SIGMA = np.repeat([0.005, 0.002], 3)  # m, rad: of any comparison


@dataclass(frozen=True)
class Sample:
    """One image: where it was placed, and where odometry was at its stamp."""

    stamp_ns: int
    T_map_camera: SE3
    covariance: Array
    T_odom_camera: SE3


class OdometryCheck:
    """Compares the poses of one drive with odometry."""

    def __init__(self, odometry_error: float) -> None:
        self._error = odometry_error  # as share of the motion
        self.forget()

    def forget(self) -> None:
        """Nothing is known: the stream or the map is another, or an operator has said where the camera is."""
        self._samples: deque[Sample] = deque()
        self._trusted: Sample | None = None
        self._gone = np.zeros(2)  # m and rad that odometry has driven since the last trusted place
        self._last_odom: SE3 | None = None
        self._is_trusted = self._is_new = False  # new: the last sample may become the trusted one
        self._information = self._pull = 0.0
        self._doubt, self._doubt_since_ns = FINE, 0
        self._compared_ns = 0

    def drive(self, T_odom_camera: SE3 | None, *, is_trusted: bool) -> None:
        """Take note of odometry at the stamp of an image, placed or not; whether the last one placed is trusted."""
        if is_trusted and self._is_new:
            self._trusted, self._gone, self._is_new = self._samples[-1], np.zeros(2), False
        self._is_trusted = is_trusted
        if T_odom_camera is not None and self._last_odom is not None:
            self._gone = self._gone + np.array(self._last_odom.distance(T_odom_camera))
        self._last_odom = T_odom_camera

    def begin(self, sample: Sample) -> None:
        """Start anew at a place found by a search."""
        self._samples.clear()
        self._is_new = False
        self._information = self._pull = 0.0
        self._doubt = FINE
        self._ask_whether_there(sample)

    def _ask_whether_there(self, sample: Sample) -> None:
        """Doubt a place that is not where odometry says the camera has gone since it was last sure."""
        before = self._trusted
        if before is None:
            return
        T_map_camera = before.T_map_camera @ before.T_odom_camera.inverse() @ sample.T_odom_camera
        xi = (T_map_camera.inverse() @ sample.T_map_camera).log()
        growth = np.repeat(self._error * self._gone, 3) ** 2 + MIN_SIGMA**2
        sigmas = float(np.sqrt(xi @ np.linalg.solve(before.covariance + sample.covariance + np.diag(growth), xi)))
        if sigmas > MAX_SIGMAS:
            detail = "standard deviations from where odometry says the camera has gone since it was last sure"
            self._doubt = Finding(Reason.ODOM_STALE, sigmas, MAX_SIGMAS, detail)
            self._doubt_since_ns = sample.stamp_ns

    def find(self, sample: Sample) -> Finding:
        """Take note of an image that was placed; return what odometry says against it."""
        if self._doubt is not FINE and sample.stamp_ns - self._doubt_since_ns > DOUBT_S * 1e9:
            self._doubt, self._trusted = FINE, None  # it has held for long
        elif self._doubt is FINE and not self._is_trusted:
            self._ask_whether_there(sample)
        self._samples.append(sample)
        while self._samples and sample.stamp_ns - self._samples[0].stamp_ns > (INTERVAL_S + 2 * SHIFT_S) * 1e9:
            self._samples.popleft()
        if sample.stamp_ns - self._compared_ns >= INTERVAL_S * 1e9:
            self._compare(sample)
        finding = self._doubt if self._doubt is not FINE else self._late()
        self._is_new = finding is FINE
        return finding

    def _late(self) -> Finding:
        """Return the delay where it is surely one."""
        if self._information <= 0.0:
            return FINE
        delay, sigma = self._pull / self._information, self._information**-0.5
        if abs(delay) - SURE_SIGMAS * sigma < MIN_DELAY_S:
            return FINE
        late = "images late against odometry" if delay > 0 else "odometry late against images"
        detail = f"s, {late}, +- {sigma:.2g}"
        return Finding(Reason.ODOM_STALE, abs(delay), MIN_DELAY_S, detail, "check the stamps of camera and odometry")

    def _compare(self, now: Sample) -> None:
        """Compare the motions over the last interval; add what they tell of the delay."""
        first = next((one for one in self._samples if now.stamp_ns - one.stamp_ns <= (INTERVAL_S + 0.02) * 1e9), now)
        shift_ns = int(SHIFT_S * 1e9)
        ends = self._odometry(first.stamp_ns - shift_ns), self._odometry(now.stamp_ns - shift_ns)
        if first is now or ends[0] is None or ends[1] is None:
            return
        self._compared_ns = now.stamp_ns
        T_odometry = first.T_odom_camera.inverse() @ now.T_odom_camera
        T_images = first.T_map_camera.inverse() @ now.T_map_camera
        residual = (T_odometry.inverse() @ T_images).log()
        change = (T_odometry.inverse() @ ends[0].inverse() @ ends[1]).log() / SHIFT_S
        metres, radians = first.T_odom_camera.distance(now.T_odom_camera)
        sigma = np.hypot(np.repeat([self._error * metres, self._error * radians], 3), MIN_SIGMA)
        weight = 1.0 / (sigma**2 + np.diagonal(first.covariance) + np.diagonal(now.covariance))
        self._information = KEPT * self._information + float(change @ (weight * change))
        self._pull = KEPT * self._pull + float(change @ (weight * residual))

    def _odometry(self, stamp_ns: int) -> SE3 | None:
        """Return odometry between two images; None where it is not known."""
        for before, after in zip(self._samples, list(self._samples)[1:], strict=False):
            if before.stamp_ns <= stamp_ns <= after.stamp_ns:
                share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
                step = (before.T_odom_camera.inverse() @ after.T_odom_camera).log()
                return before.T_odom_camera @ SE3.exp(share * step)
        return None
