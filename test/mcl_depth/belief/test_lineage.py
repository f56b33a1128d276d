"""The trajectory of the particle with the highest accumulated weight."""

from __future__ import annotations

import numpy as np

from mcl_depth.belief.hypotheses import Lineage
from mcl_depth.belief.particles import Particles


def pose(x):
    return [float(x), 0.0, 0.0]


def test_the_best_particle_and_its_ancestors_are_the_trajectory():
    lineage = Lineage()
    first = Particles.of_equal_weight(np.array([pose(0), pose(10), pose(20)])).reweight(np.array([0.2, 0.5, 0.3]))
    second = lineage.add(1, first).select(np.array([2, 2, 0]))
    second = second.with_poses(second.poses + np.array([1.0, 0.0, 0.0])).reweight(np.array([0.1, 0.6, 0.3]))
    third = lineage.add(2, second).replace_some(np.array([0]), np.array([pose(50)]), 2)
    lineage.add(3, third.reweight(np.array([0.85, 0.1, 0.05])))  # what has just begun has not earned it yet
    found = lineage.trajectory()
    assert [stamp for stamp, _ in found] == [1, 2, 3]
    np.testing.assert_allclose([place[0] for _, place in found], [20.0, 21.0, 21.0])


def test_a_particle_that_began_later_has_a_shorter_past():
    lineage = Lineage()
    lineage.add(1, Particles.of_equal_weight(np.array([pose(0), pose(10)])).reweight(np.array([0.9, 0.1])))
    later = Particles.of_equal_weight(np.array([pose(5)])).reweight(np.array([1.0]))
    lineage.add(2, later)
    assert [stamp for stamp, _ in lineage.trajectory()] == [2]
    lineage.clear()
    assert lineage.trajectory() == []


def test_particles_without_offspring_are_forgotten_and_the_trajectory_is_that_of_all():
    rng, count, num_images = np.random.default_rng(0), 100, 300
    lineage, everyone = Lineage(), []
    particles = Particles.of_equal_weight(rng.uniform(size=(count, 3)))
    for stamp in range(num_images):
        particles = particles.with_poses(particles.poses + rng.uniform(size=(count, 3)))
        everyone.append((particles.poses, particles.parents))
        particles = lineage.add(stamp, particles.reweight(rng.dirichlet(np.ones(count))))
        if stamp == 150:
            particles = particles.replace_some(np.arange(20), rng.uniform(size=(20, 3)), 2)
        index, expected = int(np.argmax(particles.scores)), []
        for poses, parents in reversed(everyone):
            expected.append(poses[index])
            index = parents[index]
            if index < 0:
                break
        found = lineage.trajectory()
        assert [at for at, _ in found] == list(range(stamp + 1 - len(expected), stamp + 1))
        np.testing.assert_array_equal([place for _, place in found], expected[::-1])
        particles = particles.select(rng.choice(count, count, p=particles.weights))
    assert len(lineage) < 0.1 * count * num_images
