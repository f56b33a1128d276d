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


def test_a_picked_color_is_one_of_the_palette_a_little_changed(rng):
    for _ in range(20):
        color = np.array(finishes.pick(rng, finishes.BRICKS))
        ratios = color / np.array(finishes.BRICKS)
        assert np.any(np.ptp(ratios, axis=1) < 1e-9)
        assert np.any((ratios > 0.87) & (ratios < 1.13))


def test_the_glyphs_of_a_sign_fill_its_height(rng):
    for lines, given in ((1, ()), (3, (3,))):
        finish = finishes.sign(0.6, 0.2, rng, *given)
        dots = 2 * 2 + 9 * lines  # of two at both borders, and of a glyph with its gap a line
        np.testing.assert_allclose(finish.params[1:], [0.6, 0.2, 0.2 / dots])
