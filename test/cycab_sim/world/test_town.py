import numpy as np
import pytest

from cycab_sim.world.town import draw_plan, taught_path


def test_the_block_is_closed_and_other_names_are_refused():
    plan = draw_plan(2)
    path = taught_path(plan, "block")
    start, end = path.at(np.array([0.0, path.length - 1e-9]))
    np.testing.assert_allclose(end[:2], start[:2], atol=1e-6)
    assert path.length > 120.0
    with pytest.raises(ValueError, match="two_turns, block, straight, found 'moon'"):
        taught_path(plan, "moon")
