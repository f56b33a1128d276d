"""The first pose, and the pose after a loss: guesses, coarse alignment, verification (M15 section 5.4).

Every key sphere offers guesses: its own place, several headings. All are compared with the image as they are, the best
are aligned at the coarsest levels, the best of those verified at full resolution with two references. A result that
another place explains nearly as well is withheld.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dense_localizer.params import LocalizerParams, StartParams
from dense_localizer.place import Place, locate
from dense_localizer.reasons import FINE, Finding, Reason
from dense_localizer.reference import NUM_DIGEST_LEVELS, References
from photometric import Pyramid, RegistrationParams, View, register
from sphere_geometry import SE3, Spherical
from sphere_mapping.graph import KeySphere
from sphere_mapping.sphere import T_BODY_OPTICAL


@dataclass(frozen=True)
class Guess:
    """A pose to try against one key sphere, and how well the image resembled it there."""

    node: KeySphere
    T_map_camera: SE3
    ncc: float = -1.0


@dataclass(frozen=True)
class Start:
    """The place found, or why none is given."""

    place: Place | None
    finding: Finding = FINE


class Startup:
    """Searches one map."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references = references
        self._params = params

    def search(self, pyramid: Pyramid) -> Start:
        """Look at all key spheres."""
        return self._find(pyramid, self._everywhere())

    def search_near(self, pyramid: Pyramid, T_map_camera: SE3) -> Start:
        """Look around a pose that was given, or lost."""
        return self._find(pyramid, self._around(T_map_camera))

    def _everywhere(self) -> Iterator[Guess]:
        """Yield guesses at every key sphere: all around a whole one, at and beside the heading of a partial one."""
        for node in self._references.nodes:
            for T_sphere_camera in headings(self._references.digest(node.id).camera, self._params.start):
                yield Guess(node, node.T_map_sphere @ T_sphere_camera)

    def _around(self, T_map_camera: SE3) -> Iterator[Guess]:
        """Yield the pose itself, and its attitude at the places of the key spheres nearby."""
        for node in self._references.nearest(T_map_camera.translation, self._params.start.num_near):
            yield Guess(node, T_map_camera)
            yield Guess(node, SE3.from_parts(T_map_camera.rotation, node.T_map_sphere.translation))

    def _find(self, pyramid: Pyramid, guesses: Iterable[Guess]) -> Start:
        seen = self._best(pyramid, guesses, num_iterations=0)
        aligned = self._best(pyramid, seen, self._params.registration.max_iterations_coarse)
        places = (self._verify(pyramid, guess) for guess in self._distinct(aligned))
        return decide([place for place in places if place is not None], self._params.start)

    def _best(self, pyramid: Pyramid, guesses: Iterable[Guess], num_iterations: int) -> list[Guess]:
        """Return the guesses, aligned at the coarsest levels, that resemble the image most."""
        num_levels = NUM_DIGEST_LEVELS if num_iterations else 1
        params = coarse(self._params.registration, len(pyramid.levels) - num_levels, num_iterations)
        scored = [self._scored(pyramid, guess, params) for guess in guesses]
        scored.sort(key=lambda guess: -guess.ncc)  # stable: equal ones stay in the order of the map
        return scored[: self._params.start.num_aligned]

    def _scored(self, pyramid: Pyramid, guess: Guess, params: RegistrationParams) -> Guess:
        view = View(self._references.digest(guess.node.id).reference, guess.node.T_map_sphere)
        found = register(pyramid, [view], guess.T_map_camera, params)
        score = found.ncc * np.sqrt(found.overlap) if found.overlap > 0 else -1.0
        return Guess(guess.node, found.T_world_camera, float(score))

    def _distinct(self, guesses: Sequence[Guess]) -> list[Guess]:
        """Return the first few guesses that are different places."""
        kept: list[Guess] = []
        for guess in guesses:
            if len(kept) == self._params.start.num_verified:
                break
            if not any(is_same_place(guess.T_map_camera, other.T_map_camera, self._params.start) for other in kept):
                kept.append(guess)
        return kept

    def _verify(self, pyramid: Pyramid, guess: Guess) -> Place | None:
        """Align at full resolution with the references of the guessed pose; None where the result is refused."""
        place = locate(pyramid, self._references, guess.T_map_camera, self._params)
        return place if place.verdict.is_accepted else None


def headings(camera: Spherical, params: StartParams) -> list[SE3]:
    """Return attitudes of an upright camera that are worth trying in a sphere, as T_sphere_camera."""
    centre = camera.unproject([(camera.width - 1) / 2, (camera.height - 1) / 2])
    first, step = np.arctan2(centre[1], centre[0]), np.radians(params.side_step_deg)
    angles = np.array([first, first - step, first + step])
    elevation = float(np.arcsin(np.clip(centre[2], -1.0, 1.0)))
    if camera.is_whole:
        angles, elevation = np.radians(np.arange(0.0, 360.0, params.heading_step_deg)), 0.0
    raised = SE3.exp([0, 0, 0, 0, -elevation, 0]) @ T_BODY_OPTICAL
    return [SE3.exp([0, 0, 0, 0, 0, angle]) @ raised for angle in np.unique(angles)]


def coarse(params: RegistrationParams, finest: int, num_iterations: int) -> RegistrationParams:
    """Return the parameters of an alignment that stops at the level `finest`."""
    pyramid = replace(params.pyramid, finest=max(0, finest))
    return replace(params, pyramid=pyramid, max_iterations_coarse=num_iterations, max_iterations_fine=num_iterations)


def is_same_place(a: SE3, b: SE3, params: StartParams) -> bool:
    """Say whether two poses are one place."""
    distance, angle = a.distance(b)
    return bool(distance < params.same_place_m and angle < np.radians(params.same_place_deg))


def decide(places: Sequence[Place], params: StartParams) -> Start:
    """Return the best place, unless it resembles the image too little or another one nearly as much."""
    ranked = sorted(places, key=lambda place: -place.ncc)
    best_ncc = ranked[0].ncc if ranked else 0.0
    if best_ncc < params.min_ncc:
        return Start(None, Finding(Reason.LOW_OVERLAP, best_ncc, params.min_ncc, "no key sphere resembles the view"))
    best = ranked[0].T_map_camera
    others = [place for place in ranked if not is_same_place(best, place.T_map_camera, params)]
    if others and best_ncc - others[0].ncc < params.min_ncc_margin:
        return Start(None, Finding(Reason.AMBIGUOUS, best_ncc - others[0].ncc, params.min_ncc_margin))
    return Start(ranked[0])
