from concurrent.futures import Future

import numpy as np

from sphere_mapping.graph.verification import Lookup, LoopTrial, find_candidates, run_in, verify
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.appearance.features import features_of_sphere
from worlds.room import sharp_room

CAMERA = Spherical(256, 128)
MOTION = SE3.from_planar(0.2, 0.1, 0.4)


class Later:
    """An executor that does its work when the answer is asked for, and counts what waits."""

    def __init__(self):
        self.waiting, self.most = 0, 0

    def submit(self, function, question):
        self.waiting += 1
        self.most = max(self.most, self.waiting)
        future = Future()

        def result():
            self.waiting -= 1
            return function(question)

        future.result = result
        return future


def test_answers_come_in_the_order_of_the_questions_and_few_wait():
    executor = Later()
    assert list(run_in(executor, 3)(lambda x: x * x, iter(range(10)))) == [x * x for x in range(10)]
    assert executor.most == 3
    assert list(run_in(executor, 3)(str, [])) == []


def test_a_place_is_found_by_features_and_the_first_that_holds_is_the_loop():
    here, elsewhere = sharp_room(), sharp_room(seed=1)
    older, newer = here.sphere(SE3.identity(), CAMERA, 1), here.sphere(MOTION, CAMERA, 2)
    other = elsewhere.sphere(SE3.identity(), CAMERA, 3)
    alike = tuple((k, features_of_sphere(sphere)) for k, sphere in ((4, other), (5, older)))
    (found,) = find_candidates(Lookup(features_of_sphere(newer), alike))
    assert found.older == 5
    assert found.T_older_newer.distance(MOTION)[0] < 0.05
    trial = LoopTrial(9, newer, ((4, other, MOTION), (5, older, found.T_older_newer)))
    edge = verify(trial)
    assert (edge.a, edge.b, edge.is_loop) == (5, 9, True)
    assert edge.T_a_b.distance(MOTION)[0] < 0.01
    assert np.all(np.linalg.eigvalsh(edge.information) > 0)
    assert verify(LoopTrial(9, newer, trial.older[:1])) is None
