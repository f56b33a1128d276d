"""Places that look alike, compared and aligned: work on a few spheres each, here or in other processes.

What is asked and answered are values, so that it makes no difference where the work is done.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, TypeVar

from sphere_mapping.constants import MIN_INLIERS, NUM_ALIKE
from sphere_mapping.graph.both_ways import measure_motion
from sphere_mapping.graph.registration import PreparedSphere
from sphere_nav.geometry import SE3
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.appearance.pose import find_pose
from sphere_nav.spheres.graph import Edge, KeySphere
from sphere_nav.spheres.sphere import Sphere

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
Run = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]  # what `map` is: answers in the order of questions


@dataclass(frozen=True)
class Candidate:
    """An older key sphere, where the newer one would be in its frame, and how many features say so."""

    older: int
    T_older_newer: SE3
    num_inliers: int


@dataclass(frozen=True, eq=False)
class Lookup:
    """The features of a new key sphere, and those of older ones that look like it, by id, the likest first."""

    features: Features
    alike: tuple[tuple[int, Features], ...]


@dataclass(frozen=True, eq=False)
class LoopTrial:
    """A new key sphere, and older ones to align it with until one holds: id, sphere and T_older_newer of each."""

    newer_id: int
    newer: Sphere
    older: tuple[tuple[int, Sphere, SE3], ...]


def look_up(known: AppearanceIndex, features: Features, without: Collection[int] = ()) -> Lookup:
    """Return what some features are to be compared with: the key spheres of an index that look most alike."""
    alike = (one.sphere_id for one in known.find(features, NUM_ALIKE, without=without))
    return Lookup(features, tuple((older, known.features[older]) for older in alike))


def trial_of(newer_id: int, newer: Sphere, found: Iterable[Candidate], load: Callable[[int], Sphere]) -> LoopTrial:
    """Return a new key sphere to be aligned with candidates from where these have it."""
    return LoopTrial(newer_id, newer, tuple((one.older, load(one.older), one.T_older_newer) for one in found))


def find_candidates(lookup: Lookup) -> list[Candidate]:
    """Return the older spheres with which enough features agree on a pose."""
    poses = [(older, find_pose(lookup.features, features)) for older, features in lookup.alike]
    return [
        Candidate(older, pose.T_sphere_camera, pose.num_inliers)
        for older, pose in poses
        if pose is not None and pose.num_inliers >= MIN_INLIERS
    ]


def verify(trial: LoopTrial) -> Edge | None:
    """Return the loop edge to the first of the older spheres that dense alignment confirms, both ways."""
    newer = PreparedSphere(trial.newer)
    for older_id, sphere, guess in trial.older:
        motion = measure_motion(PreparedSphere(sphere), newer, guess)
        if motion is not None:
            return motion.edge(older_id, trial.newer_id, is_loop=True)
    return None


def verify_all(
    asked: Iterable[tuple[int, Sequence[Candidate]]],
    load_older: Callable[[int], Sphere],
    load_newer: Callable[[int], Sphere],
    run: Run = map,
) -> list[Edge]:
    """Return the edges that are confirmed of new key spheres by id, and the candidates that each is aligned with."""
    trials = (trial_of(newer_id, load_newer(newer_id), found, load_older) for newer_id, found in asked)
    return [edge for edge in run(verify, trials) if edge is not None]


def verify_pairs(
    pairs: Iterable[tuple[KeySphere, KeySphere]],
    load_older: Callable[[int], Sphere],
    load_newer: Callable[[int], Sphere],
    run: Run = map,
) -> list[Edge]:
    """Return the edges of key spheres (older, newer) that are confirmed from where the graph has them."""
    guesses = ((a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere) for a, b in pairs)
    return verify_all(((b, [Candidate(a, T_a_b, 0)]) for a, b, T_a_b in guesses), load_older, load_newer, run)


def run_in(executor: Executor, num_ahead: int) -> Run:
    """Return what runs work in an executor, in order; no more than `num_ahead` pieces are held in memory."""

    def run(function: Callable[[Asked], Answer], questions: Iterable[Asked]) -> Iterator[Answer]:
        coming: deque[Future[Answer]] = deque()
        for question in questions:
            coming.append(executor.submit(function, question))
            if len(coming) >= num_ahead:
                yield coming.popleft().result()
        while coming:
            yield coming.popleft().result()

    return run
