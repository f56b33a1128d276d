"""Where the next sphere is likely to be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sphere_mapping.constants import (
    ACCELERATION,
    CONTRADICTED,
    EXPECTED_FLOOR,
    MAX_KNOWN,
    ODOMETRY_SHARE,
    SHARP,
)
from sphere_nav.estimation.least_squares import gate
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class Expectation:
    """Where a sphere should be by what was known before it was seen, with standard deviations; +Inf: anywhere.

    is_known: odometry tells the motion, or that of the last spheres goes on; else it is a mere guess.
    """

    T_map_sphere: SE3
    sigma_m: float
    sigma_rad: float
    is_known: bool = True

    def allows(self, T_map_sphere: SE3) -> bool:
        """Say whether a pose lies within the gate, three numbers of either deviation."""
        distance, angle = self.T_map_sphere.distance(T_map_sphere)
        return bool(max(distance / self.sigma_m, angle / self.sigma_rad) ** 2 <= gate(3))

    @property
    def is_sharp(self) -> bool:
        """Whether it could tell a wrong alignment from a right one."""
        return self.sigma_m <= SHARP[0] and self.sigma_rad <= SHARP[1]


@dataclass(frozen=True, eq=False)
class Placed:
    """A sphere that was placed: its stamp, its pose in the map and, where there is one, in the odometry frame."""

    stamp_ns: int
    T_map_sphere: SE3
    T_odom_sphere: SE3 | None = None


@dataclass
class DriveMotion:
    """Carries the motion between the last two placed spheres on, or that of the odometry where it is given."""

    last: Placed | None = None
    before: Placed | None = None
    num_lost: int = 0  # spheres in a row since the last one

    def update(self, placed: Placed) -> None:
        """Take down a placed sphere; after several that were lost, a jump perhaps, there is no velocity to it."""
        self.before = self.last if self.num_lost < CONTRADICTED else None
        self.last, self.num_lost = placed, 0

    def lose(self) -> None:
        """Take down that a sphere was not placed."""
        self.num_lost += 1

    @property
    def newest(self) -> SE3:
        """T_map_sphere of the last placed sphere; identity before the first."""
        return self.last.T_map_sphere if self.last is not None else SE3.identity()

    def transform(self, T_map_before: SE3) -> None:
        """Follow a correction of the map: poses that were in the map as it was before it."""
        self.last, self.before = (
            placed and replace(placed, T_map_sphere=T_map_before @ placed.T_map_sphere)
            for placed in (self.last, self.before)
        )

    def predict(self, stamp_ns: int, T_odom_sphere: SE3 | None = None) -> SE3:
        """Return the expected T_map_sphere at a stamp; identity before the first sphere."""
        if self.last is None:
            return SE3.identity()
        if T_odom_sphere is not None and self.last.T_odom_sphere is not None:
            return self.last.T_map_sphere @ self.last.T_odom_sphere.inverse() @ T_odom_sphere
        elapsed = max(self._elapsed(stamp_ns), 0.0)  # at constant velocity
        return self.newest @ SE3.exp(((self.before or self.last).T_map_sphere.inverse() @ self.newest).log() * elapsed)

    def velocity(self) -> Array:
        """Return the velocity (6,) (v, omega) per second between the last two spheres, zero where there are none."""
        return _velocity(self.before, self.last)

    def velocity_to(self, T_map_sphere: SE3, stamp_ns: int) -> Array:
        """Return the velocity (6,) from the last sphere to a pose at a stamp; zero before the first."""
        return _velocity(self.last, Placed(stamp_ns, T_map_sphere))

    def velocity_through(self, T_map_next: SE3, stamp_ns: int) -> Array:
        """Return the velocity (6,) at the last sphere by the one before it and the next one, at a stamp."""
        return _velocity(self.before or self.last, Placed(stamp_ns, T_map_next))

    def expect(self, stamp_ns: int, T_odom_sphere: SE3 | None = None) -> Expectation:
        """Return the expected pose and how far off it may be: by odometry, by velocity, or not at all.

        Odometry that several spheres in a row contradict has jumped, or has not seen a jump: it is not believed.
        """
        T_odom_sphere = None if self.num_lost >= CONTRADICTED else T_odom_sphere
        guess = self.predict(stamp_ns, T_odom_sphere)
        has_odometry = T_odom_sphere is not None and self.last is not None and self.last.T_odom_sphere is not None
        if self.last is None or (self.before is None and not has_odometry):
            return Expectation(guess, np.inf, np.inf, is_known=False)
        is_known = True
        if has_odometry:
            distance, angle = self.last.T_map_sphere.distance(guess)
            growth = ODOMETRY_SHARE * float(distance), ODOMETRY_SHARE * float(angle)
        else:
            elapsed_s = (stamp_ns - self.last.stamp_ns) * 1e-9
            growth = 0.5 * ACCELERATION[0] * elapsed_s**2, 0.5 * ACCELERATION[1] * elapsed_s**2
            is_known = self._elapsed(stamp_ns) <= MAX_KNOWN
        return Expectation(guess, EXPECTED_FLOOR[0] + growth[0], EXPECTED_FLOOR[1] + growth[1], is_known)

    def _elapsed(self, stamp_ns: int) -> float:
        """Return the time since the last sphere in intervals of the motion before; 0 where there is none."""
        if self.last is None or self.before is None or self.last.stamp_ns <= self.before.stamp_ns:
            return 0.0
        return (stamp_ns - self.last.stamp_ns) / (self.last.stamp_ns - self.before.stamp_ns)


def _velocity(first: Placed | None, then: Placed | None) -> Array:
    """Return the velocity (6,) from a placed sphere to a later one; zero where there is none."""
    if first is None or then is None or then.stamp_ns <= first.stamp_ns:
        return np.zeros(6)
    return (first.T_map_sphere.inverse() @ then.T_map_sphere).log() / ((then.stamp_ns - first.stamp_ns) * 1e-9)
