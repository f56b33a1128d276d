"""When and where to search: around a pose that was given or lost, and from time to time in the whole map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.startup import Start, Startup
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE
from sphere_nav.photometric.align.rig import RigImage

PERIOD_S = 0.5  # between two searches of the whole map
NEAR_S = 2.0  # for which a given or lost pose is tried


class Search:
    """The searches of one map, timed by image stamps."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references = references
        self._params, self._is_automatic = params.start, params.automatic
        self._startup = Startup(references, params)
        self.forget()

    @property
    def is_wanted(self) -> bool:
        """Whether anything will be looked for."""
        return self._is_automatic or self._is_asked or self._T_map_guess is not None

    def forget(self) -> None:
        """Nothing is asked for, nothing is known of the past."""
        self._T_map_guess: SE3 | None = None
        self._guess_until_ns: int | None = None
        self._next_ns = 0
        self._is_asked = False
        self._finding = FINE

    def ask(self, T_map_camera: SE3 | None) -> None:
        """Search near a pose, or everywhere; ValueError for a pose that is far from every key sphere."""
        if T_map_camera is not None:
            self._check(T_map_camera)
        self.forget()
        self._is_asked = T_map_camera is None
        self._T_map_guess = T_map_camera

    def lost(self, T_map_camera: SE3) -> None:
        """Search near the pose where the camera was lost, then everywhere."""
        self._T_map_guess, self._guess_until_ns = T_map_camera, None

    def find(self, images: Sequence[RigImage], stamp_ns: int) -> Start:
        """Search with one instant what is due; between two searches the last finding stands."""
        start = self._find_near(images, stamp_ns)
        is_due = stamp_ns >= self._next_ns and (self._is_automatic or self._is_asked)
        if start.place is None and is_due:
            self._next_ns = stamp_ns + int(PERIOD_S * 1e9)
            start = self._startup.search(images)
        self._finding = start.finding
        return start

    def _find_near(self, images: Sequence[RigImage], stamp_ns: int) -> Start:
        if self._T_map_guess is None:
            return Start(None, self._finding)
        if self._guess_until_ns is None:
            self._guess_until_ns = stamp_ns + int(NEAR_S * 1e9)
        if stamp_ns > self._guess_until_ns:
            self._T_map_guess = None
            return Start(None, self._finding)
        return self._startup.search_near(images, self._T_map_guess)

    def _check(self, T_map_camera: SE3) -> None:
        if not np.all(np.isfinite(T_map_camera.matrix)):
            raise ValueError("initial pose: expected finite numbers, found NaN or Inf")
        nearest = self._references.nearest(T_map_camera.translation, 1)
        distance = float(nearest[0].T_map_sphere.distance(T_map_camera)[0]) if nearest else np.inf
        limit = self._params.max_guess_distance_m
        if distance > limit:
            raise ValueError(f"initial pose: expected at most {limit:g} m from a key sphere, found {distance:.1f} m")
