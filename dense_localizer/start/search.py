"""When and where to search: around a pose that was given or lost, and from time to time in the whole map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dense_localizer.constants import MAX_REACH_M, SEARCH_NEAR_S, SEARCH_PERIOD_S
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.startup import SearchResult, Startup, decide
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason

Locate = Callable[[LocalizerInput, Prediction], PoseCandidate]
NUM_KINDS = 3  # of searches in the whole map


class PoseSearch:
    """The searches of one map, timed by image stamps."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references = references
        self._params, self._is_automatic = params.start, params.automatic
        self._startup = Startup(references, params)
        self.reset()

    @property
    def is_wanted(self) -> bool:
        """Whether a pose is searched for at all."""
        return self._is_automatic or self._is_requested or self._T_map_guess is not None

    def reset(self) -> None:
        """Nothing is requested, nothing is known of the past."""
        self._T_map_guess: SE3 | None = None
        self._T_odom_guess: SE3 | None = None  # odometry there
        self._guess_until_ns: int | None = None
        self._next_ns = self._num_near = self._num_whole = 0  # searches that have found nothing
        self._is_requested = self._is_near = False  # near: the last images were searched with near a pose
        self._finding = FINE

    def request(self, T_map_camera: SE3 | None) -> None:
        """Search near a pose, or everywhere; ValueError for a pose that is far from every key sphere."""
        if T_map_camera is not None:
            self._check(T_map_camera)
        self.reset()
        self._is_requested = T_map_camera is None
        self._T_map_guess = T_map_camera

    def start_near(self, T_map_camera: SE3, frame: LocalizerInput) -> None:
        """Search near the pose where the camera was lost at an instant, then everywhere."""
        self._T_map_guess, self._T_odom_guess, self._guess_until_ns = T_map_camera, frame.T_odom_camera, None

    def find(self, frame: LocalizerInput, locate: Locate) -> SearchResult:
        """Search with one instant what is due, guesses aligned by `locate`; between searches the last finding stands.

        Where there are no images, or nothing is to be searched for, the finding is that of the instant.
        """
        if not (self.is_wanted and frame.images):
            return SearchResult(None, frame.finding)
        self._move_guess(frame.T_odom_camera)
        guesses = self._propose(frame)
        if not guesses:
            return SearchResult(None, self._finding)
        result = decide([locate(frame, guess) for guess in guesses], self._params)
        self._finding = result.finding
        if result.candidate is not None:
            self._references.adopt(result.candidate.choice)
        return result

    def _move_guess(self, T_odom_camera: SE3 | None) -> None:
        """Move a given or lost pose as the camera has moved since, by odometry where there is any."""
        if self._T_map_guess is None or T_odom_camera is None:
            return
        if self._T_odom_guess is not None:
            self._T_map_guess = self._T_map_guess @ self._T_odom_guess.inverse() @ T_odom_camera
        self._T_odom_guess = T_odom_camera

    def _propose(self, frame: LocalizerInput) -> list[Prediction]:
        """Return poses to try with one instant: near a given or lost one, or in the whole map where that is due.

        Where both are wanted, in turn.
        """
        if self._T_map_guess is not None and self._guess_until_ns is None:
            self._guess_until_ns = frame.stamp_ns + int(SEARCH_NEAR_S * 1e9)
        if self._guess_until_ns is not None and frame.stamp_ns > self._guess_until_ns:
            self._T_map_guess = None
        is_due = frame.stamp_ns >= self._next_ns and (self._is_automatic or self._is_requested)
        if self._T_map_guess is not None and not (is_due and self._is_near):
            self._is_near = True
            return self._propose_near(frame, self._T_map_guess)
        self._is_near = False
        return self._propose_anywhere(frame) if is_due else []

    def _propose_near(self, frame: LocalizerInput, T_map_guess: SE3) -> list[Prediction]:
        """Return a pose and others about it; parts of each image are asked of another one, the pose itself first.

        It is one of them, as in another light grey levels that fit nowhere lead away from it; then it is tried by local
        contrast with every other image.
        """
        number, self._num_near = self._num_near, self._num_near + 1
        near = [T_map_guess, *self._startup.propose_near(frame.images[number % len(frame.images)], T_map_guess)]
        guesses = [Prediction.guess(pose, is_near=True) for pose in near]
        guesses = [replace(guess, asks_parts=one == number % len(near)) for one, guess in enumerate(guesses)]
        if number % 2 == 0 and self._references.knows_contrast and not self._references.by_contrast:
            guesses[0] = replace(guesses[0], asks_parts=True, by_contrast=True)
        return guesses

    def _propose_anywhere(self, frame: LocalizerInput) -> list[Prediction]:
        """Return poses of an upright camera, of one in another light, of a turned one: in turn, each camera by each.

        Where two places look alike to an upright camera, only that is asked: another kind may know but one of them.
        """
        self._next_ns = frame.stamp_ns + int(SEARCH_PERIOD_S * 1e9)
        if self._finding.reason is Reason.AMBIGUOUS:
            self._num_whole += -self._num_whole % NUM_KINDS
        rounds, kind = divmod(self._num_whole, NUM_KINDS)
        self._num_whole += 1
        seen = frame.images[rounds % len(frame.images)]
        if kind == 0:
            return list(map(Prediction.guess, self._startup.propose(seen)))
        if kind == 1:
            return [Prediction.guess(pose, experience=one) for pose, one in self._startup.propose_by_edges(seen)]
        return list(map(Prediction.guess, self._startup.propose_turned(seen)))

    def _check(self, T_map_camera: SE3) -> None:
        if not np.all(np.isfinite(T_map_camera.matrix)):
            raise ValueError("initial pose: expected finite numbers, found NaN or Inf")
        nearest = self._references.nearest(T_map_camera.translation, 1)
        distance = float(nearest[0].T_map_sphere.distance(T_map_camera)[0]) if nearest else np.inf
        if distance > MAX_REACH_M:
            raise ValueError(
                f"initial pose: expected at most {MAX_REACH_M:g} m from a key sphere, found {distance:.1f} m"
            )
