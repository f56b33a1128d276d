"""When and where to search: around a pose that was given or lost, and from time to time in the whole map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from dense_localizer.constants import MAX_GUESS_M, NUM_WHOLE_SEARCHES, SEARCH_NEAR_S, SEARCH_PERIOD_S
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.startup import SearchResult, Startup, decide
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason

Locate = Callable[[LocalizerInput, Prediction], PoseCandidate]


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
        self._is_requested = False
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
        result = SearchResult(None, self._finding)
        for guesses in self._propose(frame):
            result = decide([locate(frame, guess) for guess in guesses], self._params)
            self._finding = result.finding
            if result.candidate is not None:
                self._references.adopt(result.candidate.choice)
                break
        return result

    def _move_guess(self, T_odom_camera: SE3 | None) -> None:
        """Move a given or lost pose as the camera has moved since, by odometry where there is any."""
        if self._T_map_guess is None or T_odom_camera is None:
            return
        if self._T_odom_guess is not None:
            self._T_map_guess = self._T_map_guess @ self._T_odom_guess.inverse() @ T_odom_camera
        self._T_odom_guess = T_odom_camera

    def _propose(self, frame: LocalizerInput) -> Iterator[list[Prediction]]:
        """Yield poses to try: near a given or lost one, then in the whole map where that is due."""
        if self._T_map_guess is not None and self._guess_until_ns is None:
            self._guess_until_ns = frame.stamp_ns + int(SEARCH_NEAR_S * 1e9)
        if self._guess_until_ns is not None and frame.stamp_ns > self._guess_until_ns:
            self._T_map_guess = None
        if self._T_map_guess is not None:
            yield self._propose_near(frame, self._T_map_guess)
            is_gray = self._references.knows_contrast and not self._references.by_contrast
            if is_gray and self._finding.reason is not Reason.AMBIGUOUS:  # by night grey levels lead away from it
                yield [replace(Prediction.guess(self._T_map_guess, is_near=True), by_contrast=True)]
        if frame.stamp_ns >= self._next_ns and (self._is_automatic or self._is_requested):
            self._next_ns = frame.stamp_ns + int(SEARCH_PERIOD_S * 1e9)
            yield from self._propose_anywhere(frame)

    def _propose_near(self, frame: LocalizerInput, T_map_guess: SE3) -> list[Prediction]:
        """Return a pose and others about it; parts of each image are asked of another one, the pose itself first.

        It is one of them, as in another light grey levels that fit nowhere lead away from it.
        """
        near = [T_map_guess, *self._startup.propose_near(frame.images, T_map_guess)]
        asked, self._num_near = self._num_near % len(near), self._num_near + 1
        guesses = [Prediction.guess(pose, is_near=True) for pose in near]
        return [replace(guess, asks_parts=number == asked) for number, guess in enumerate(guesses)]

    def _propose_anywhere(self, frame: LocalizerInput) -> Iterator[list[Prediction]]:
        """Yield poses of an upright camera, of one in another light, of a turned one; these in turn after a while.

        Who is lost for long mostly stands where no map is: to ask all each time would take a core for nothing.
        """
        images = frame.images
        asks_all, is_turned = self._num_whole < NUM_WHOLE_SEARCHES, self._num_whole // len(images) % 2 == 0
        self._num_whole += 1  # every camera serves once before the other is asked
        yield list(map(Prediction.guess, self._startup.propose(images)))
        if self._finding.reason is Reason.AMBIGUOUS:
            return
        if asks_all or not is_turned:
            by_edges = self._startup.propose_by_edges(images)
            yield [Prediction.guess(pose, experience=experience) for pose, experience in by_edges]
        if asks_all or is_turned:
            yield list(map(Prediction.guess, self._startup.propose_turned(images)))

    def _check(self, T_map_camera: SE3) -> None:
        if not np.all(np.isfinite(T_map_camera.matrix)):
            raise ValueError("initial pose: expected finite numbers, found NaN or Inf")
        nearest = self._references.nearest(T_map_camera.translation, 1)
        distance = float(nearest[0].T_map_sphere.distance(T_map_camera)[0]) if nearest else np.inf
        if distance > MAX_GUESS_M:
            raise ValueError(
                f"initial pose: expected at most {MAX_GUESS_M:g} m from a key sphere, found {distance:.1f} m"
            )
