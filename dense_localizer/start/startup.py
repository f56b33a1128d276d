"""The first pose, and the pose after a loss: guesses, coarse alignment, decision (M15 section 5.4).

The key spheres that look like the image (all of a small map) offer guesses: poses in and about their centers, and
where features place the image. All are compared with the image, a few hundred points of the sphere projected from each
pose into its coarsest level; the best are aligned at that level, which ranks them as well as a finer one. Those that
are not clearly behind are for the localizer to align at full resolution with two references. A result that another
place explains nearly as well is withheld.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from dense_localizer.constants import (
    CLEAR_LEAD,
    MAX_PITCH_RAD,
    MAX_REACH_M,
    MIN_COMPARED_POINTS,
    NUM_ALIGNED,
    NUM_CANDIDATES,
    NUM_COMPARED_POINTS,
    NUM_SEEN_POINTS,
    NUM_TURNED,
    NUM_VERIFIED,
    PARTIAL_STEP_DEG,
    ROLL_STEP_DEG,
)
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.motion_prior import Ground
from dense_localizer.params import LocalizerParams, SearchParams
from dense_localizer.references.coarse_reference import stop_at
from dense_localizer.references.reference import References
from dense_localizer.start.guesses import (
    EdgeSearch,
    Guess,
    find_body_axes,
    is_same_pose,
    recognize,
    select_best,
    select_distinct,
)
from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.photometric import View, register
from sphere_nav.photometric.align.esm import correlate
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.pixels.pyramid import in_blocks, view_cone
from sphere_nav.spheres.graph import Experience, KeySphere


class SearchResult(NamedTuple):
    """The candidate found, or why none is given."""

    candidate: PoseCandidate | None
    finding: Verdict = FINE


class Startup:
    """Proposes poses T_map_body in one map, the likeliest first, all of them different places."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references = references
        self._params = params
        self._by_edges = EdgeSearch(references)

    def propose(self, seen: RigImage) -> list[SE3]:
        """Compare the key spheres that look like the image, where features place it and from many poses in each.

        The vehicle is taken as upright, and where nobody says how the camera sits on it, the camera.
        """
        attitude = find_attitude(seen, self._references.ground)
        nodes, placed = self._recognize(seen, [attitude], NUM_CANDIDATES)
        placed = placed[: NUM_ALIGNED - 1]
        return self._refine(seen, placed + self._compare_all(seen, nodes, [attitude], NUM_ALIGNED - len(placed)))

    def propose_turned(self, seen: RigImage) -> list[SE3]:
        """Do the same for a camera that is turned about its axis in any way; where features place it, these suffice."""
        upright = find_attitude(seen, self._references.ground)
        turns = np.radians(np.arange(ROLL_STEP_DEG, 360.0, ROLL_STEP_DEG))
        attitudes = [upright @ SE3.from_angles(roll, 0.0, 0.0, np.zeros(3)) for roll in turns.tolist()]
        nodes, placed = self._recognize(seen, [upright, *attitudes], 0)
        compared = placed[:NUM_ALIGNED] or self._compare_all(seen, nodes[:NUM_TURNED], attitudes, NUM_ALIGNED)
        return self._refine(seen, compared)

    def propose_by_edges(self, seen: RigImage) -> list[tuple[SE3, Experience]]:
        """Compare edges of the image with key spheres: in another light grey levels do not say where, nor features.

        Return with each pose the experience that the image resembles there.
        """
        found = self._by_edges.propose(seen, find_attitude(seen, self._references.ground))
        return [(seen.body(one.T_map_camera), one.node.experience) for one in found]

    def _recognize(self, seen: RigImage, attitudes: Sequence[SE3], most: int) -> tuple[list[KeySphere], list[Guess]]:
        """Return the key spheres that look like the image, and where its features place it; all where there are few."""
        node = self._references.node
        if len(self._references.appearance) <= most:
            return list(self._references.nodes), []
        alike, poses = recognize(self._references.appearance, seen.pyramid, attitudes)
        return list(map(node, alike)), [Guess(node(one), node(one).T_map_sphere @ T) for one, T in poses]

    def _compare_all(
        self, seen: RigImage, nodes: Sequence[KeySphere], attitudes: Sequence[SE3], count: int
    ) -> list[Guess]:
        """Return the best of many poses in some key spheres."""
        look, guesses = cache(partial(ways_to_look, self._params.start, seen.pyramid.cameras[0])), list[Guess]()
        for node in nodes:
            coarse = self._references.coarse[node.id]
            for attitude in attitudes:
                guesses += self._compare(seen, node, candidate_poses(*look(coarse.camera, attitude), coarse.step_m))
        return select_best(guesses, count)

    def propose_near(self, seen: RigImage, T_map_body: SE3) -> list[SE3]:
        """Compare poses around one that was given, or lost: there, and with its attitude at key spheres."""
        T_map_camera, attitude = seen.pose(T_map_body), find_attitude(seen, self._references.ground)
        nodes = self._references.nearest(T_map_camera.translation, self._params.reference.num_references, MAX_REACH_M)
        places = [(node.T_map_sphere @ attitude).translation for node in nodes]
        there = [SE3.from_parts(T_map_camera.rotation, place) for place in places]
        return self._refine(seen, list(map(Guess, nodes[:1] + nodes, [T_map_camera, *there])))

    def _compare(self, seen: RigImage, node: KeySphere, T_sphere_camera: SE3) -> list[Guess]:
        """Return the best of several poses in a sphere, with how much the image resembles it there.

        That is their correlation, weakened where few points are seen; -1 where too few.
        """
        pixels = self._references.coarse.reference(node.id).levels[-1].pixels
        *_, angle = view_cone(seen.pyramid.cameras[0]).tolist()
        num_around = pixels.shape[1] * 0.5 * (1.0 - np.cos(angle))
        pixels = pixels[:, :: max(1, int(min(pixels.shape[1] / NUM_COMPARED_POINTS, num_around / NUM_SEEN_POINTS)))]
        blocks, level = in_blocks(pixels), seen.pyramid.levels[-1]
        ncc, count = np.array([correlate(blocks, SE3(T), level) for T in T_sphere_camera.inverse().matrix]).T
        scores = np.where(count >= MIN_COMPARED_POINTS, ncc * np.sqrt(count / pixels.shape[1]), -1.0)
        best = np.argsort(-scores, kind="stable")[:NUM_ALIGNED].tolist()
        return [Guess(node, node.T_map_sphere @ T_sphere_camera[row], float(scores[row])) for row in best]

    def _refine(self, seen: RigImage, guesses: Sequence[Guess]) -> list[SE3]:
        aligned = select_best([self._align(seen, guess) for guess in guesses], len(guesses))
        near_best = [guess for guess in aligned if guess.score >= aligned[0].score - CLEAR_LEAD]
        return [seen.body(guess.T_map_camera) for guess in select_distinct(near_best, NUM_VERIFIED)]

    def _align(self, seen: RigImage, guess: Guess) -> Guess:
        """Return a guess after alignment at the coarsest level."""
        params = stop_at(len(seen.pyramid.levels) - 1, self._params.registration)
        view = View(self._references.coarse.reference(guess.node.id), guess.node.T_map_sphere)
        expected = self._references.ground.expect(guess.T_map_camera, seen.T_body_camera)
        found = register(seen.pyramid, [view], guess.T_map_camera, params, expected=expected)
        score = found.ncc * np.sqrt(found.overlap) if found.overlap > 0 else -1.0
        return Guess(guess.node, found.T_world_camera, float(score))


def find_attitude(seen: RigImage, ground: Ground) -> SE3:
    """Return T_level_camera of the camera's body axes on an upright vehicle above a key sphere, its heading left out.

    Upright where nobody says how the camera sits, or where it would look up or down, as of optical axes for a base; as
    high as the key sphere where nobody says how that sat.
    """
    T_base_camera = ground.camera_on_base(seen.T_body_camera)
    if T_base_camera is None:
        return SE3.identity()
    R = T_base_camera.rotation @ find_body_axes(seen.pyramid.cameras[0]).rotation.T
    roll, pitch, _ = SE3.from_parts(R, np.zeros(3)).angles
    is_steep = abs(pitch) > MAX_PITCH_RAD
    above = np.array([0.0, 0.0, ground.height_above(T_base_camera)])
    return SE3.from_parts(np.eye(3), above) if is_steep else SE3.from_angles(float(roll), float(pitch), 0.0, above)


def ways_to_look(params: SearchParams, camera: Camera, window: Spherical, attitude: SE3) -> tuple[SE3, Array]:
    """Return N poses T_sphere_camera in the middle of an upright sphere, and the directions (N, 3) that they go on in.

    All around in a whole sphere; in and beside the middle of a partial one. `attitude`: that of `find_attitude`.
    """
    roll, pitch, _ = attitude.angles
    center = window.unproject([(window.width - 1) / 2, (window.height - 1) / 2])
    step = np.radians(PARTIAL_STEP_DEG)
    if window.is_whole:
        azimuths, elevations = np.radians(np.arange(0.0, 360.0, params.heading_step_deg)), np.array([-pitch])
    else:
        azimuths = np.arctan2(center[1], center[0]) + step * np.arange(-2, 3)
        elevations = np.arcsin(np.clip(center[2], -1.0, 1.0)) + step * np.arange(-1, 2)
    above = [0.0, 0.0, attitude.translation[2]]
    looks = [
        SE3.from_angles(float(roll), -elevation, azimuth, above).matrix
        for azimuth in azimuths.tolist()
        for elevation in elevations.tolist()
    ]
    T_sphere_body = SE3(np.array(looks))
    return T_sphere_body @ find_body_axes(camera), T_sphere_body.rotation[..., 0]


def candidate_poses(T_sphere_camera: SE3, ahead: Array, step_m: float) -> SE3:
    """Return each of N poses a step behind, as it is, and a step before: a batch of 3 N."""
    moved = T_sphere_camera.translation[:, None] + step_m * np.arange(-1, 2)[:, None] * ahead[:, None]
    return SE3(SE3.from_parts(T_sphere_camera.rotation[:, None], moved).matrix.reshape(-1, 4, 4))


def decide(candidates: Sequence[PoseCandidate], params: SearchParams) -> SearchResult:
    """Return the best good candidate, unless it resembles the image too little or another one nearly as much.

    Where none resembles it, the one place that parts of the view prove, or that range finds.
    """
    ranked = sorted((one for one in candidates if one.acceptance.is_good), key=lambda one: -one.ncc)
    best_ncc = ranked[0].ncc if ranked else 0.0
    if best_ncc < params.min_ncc:
        found = [one for one in ranked if one.is_by_parts] or [one for one in ranked if one.is_by_range]
        if found and all(is_same_pose(found[0].T_map_camera, one.T_map_camera) for one in found[1:]):
            return SearchResult(found[0])
        finding = Verdict(Reason.LOW_OVERLAP, best_ncc, params.min_ncc, "no key sphere resembles the view")
        return SearchResult(None, finding)
    best = ranked[0].T_map_camera
    others = [one for one in ranked if not is_same_pose(best, one.T_map_camera)]
    if others and best_ncc - others[0].ncc < params.min_ncc_margin:
        return SearchResult(None, Verdict(Reason.AMBIGUOUS, best_ncc - others[0].ncc, params.min_ncc_margin))
    return SearchResult(ranked[0])
