"""A filter let loose on a drive through a world whose bare geometry it has, and what it said of each image."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bare.drives import HEIGHT, Step, limits
from cycab_sim.world.town import Plan, draw_plan
from cycab_sim.world.worlds import geometry_cloud
from mcl_depth.belief.particles import wrap_angle
from mcl_depth.filter import Filter
from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import State
from sphere_nav.params import build

SPACING = 0.2  # of the points of a cloud, m
NEAR_M, NEAR_DEG = 1.0, 10.0  # a pose this close to the truth is the right place


@dataclass(frozen=True)
class Trial:
    """What a filter said of K images: state and reason, errors of the likeliest place, CPU, all (K,)."""

    states: tuple[State, ...]
    reasons: tuple[str, ...]
    meters: Array
    degrees: Array
    p_chance: Array
    cpu_ms: Array

    @property
    def is_right(self) -> NDArray[np.bool_]:
        """Whether the likeliest place was the right one, (K,)."""
        return (self.meters <= NEAR_M) & (self.degrees <= NEAR_DEG)

    @property
    def is_tracking(self) -> NDArray[np.bool_]:
        """Whether the status was TRACKING, (K,)."""
        return np.array([state is State.TRACKING for state in self.states])

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Whether a pose left the filter: TRACKING or DEGRADED, (K,)."""
        return np.array([state in (State.TRACKING, State.DEGRADED) for state in self.states])

    @property
    def has_converged(self) -> bool:
        """Whether the last image found the filter in TRACKING at the right place."""
        return bool(self.is_tracking[-1] and self.is_right[-1])

    @property
    def num_false(self) -> int:
        """Images with the status TRACKING at a wrong place."""
        return int(np.sum(self.is_tracking & ~self.is_right))


def town(seed: int, share: float = 1.0) -> tuple[Site, Plan]:
    """Return the 100 x 100 m around the middle of a town, or a share of it from the left, and the town's plan."""
    plan, cloud = draw_plan(seed), geometry_cloud(seed, SPACING, "town")
    x0, y0, x1, y1 = limits(plan)
    box = {"area.limits": f"{x0:.2f},{y0:.2f},{x0 + share * (x1 - x0):.2f},{y1:.2f}"}
    return Site(cloud_from_points(cloud.astype(np.float32), "town"), HEIGHT, build(FilterParams, box)), plan


def run_filter(site: Site, steps: Iterable[Step], seed: int, start: tuple[Array, Array] | None = None) -> Trial:
    """Return what a filter says of the images of a drive.

    It knows nothing, or a `start`: pose (3,) and standard deviations (3,).
    """
    filter_ = Filter(replace(site.params, seed=seed), site.depth_map, site.area)
    if start is not None:
        (x, y, yaw), (sigma_x, sigma_y, sigma_yaw) = start
        covariance = np.diag(np.square([sigma_x, sigma_y, 0.1, 0.1, 0.1, sigma_yaw]))
        filter_.start(SE3.from_planar(float(x), float(y), float(yaw)), covariance)
    found: list[tuple[Any, ...]] = []
    for observation, truth in steps:
        begun = time.process_time()
        estimate = filter_.update(observation)
        cpu_ms = 1e3 * (time.process_time() - begun)
        error, status = place_of(estimate) - truth, estimate.status
        degrees = abs(float(np.degrees(wrap_angle(error[2]))))
        meters = float(np.hypot(*error[:2]))
        found.append((status.state, str(status.reason), meters, degrees, status.p_chance, cpu_ms))
    states, reasons, *numbers = zip(*found, strict=True)
    return Trial(states, reasons, *map(np.array, numbers))


def place_of(estimate: Any) -> Array:
    """Return x, y, yaw (3,) of what leaves the filter, else of its likeliest place, else NaN."""
    if estimate.T_map_level is not None:
        T_map_level: SE3 = estimate.T_map_level
        return np.array([*T_map_level.translation[:2], float(T_map_level.yaw)])
    if estimate.belief is not None:
        return np.asarray(estimate.belief.best.pose)
    return np.full(3, np.nan)
