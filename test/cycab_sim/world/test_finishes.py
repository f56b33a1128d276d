import numpy as np

from cycab_sim.world import finishes
from cycab_sim.world.mesh import NUM_PARAMS, Finish


def test_every_finish_reflects_less_than_it_gets(rng):
    made = [finishes.wall(rng) for _ in range(30)] + [finishes.sign(1.0, 0.5, rng) for _ in range(10)]
    made += [finishes.window(1.0, 1.5, (0.4, 0.4, 0.4), rng), finishes.foliage(rng), finishes.slats((0.3, 0.2, 0.1))]
    made += [item for item in vars(finishes).values() if isinstance(item, Finish)]
    for finish in made:
        assert np.min([finish.color, finish.second]) > 0.0
        assert np.max([finish.color, finish.second]) < 0.9
        assert 1 <= len(finish.params) <= NUM_PARAMS
        assert 0.05 < finish.params[0] < 0.5  # contrast: no surface is without texture
