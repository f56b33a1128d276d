"""The trajectory of the particle with the highest accumulated weight."""

from __future__ import annotations

import numpy as np

from mcl_depth.belief.hypotheses import Lineage
from mcl_depth.belief.particles import Particles


def pose(x):
    return [float(x), 0.0, 0.0]


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
