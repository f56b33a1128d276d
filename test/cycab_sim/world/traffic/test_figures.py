import numpy as np

from cycab_sim.world.traffic import figures


def test_a_figure_fills_the_room_that_it_says():
    for make, height in [
        (figures.make_car, (1.3, 1.8)),
        (figures.make_tram, (3.0, 3.5)),
        (figures.make_pedestrian, (1.5, 1.9)),
        (figures.make_cyclist, (1.5, 1.95)),
    ]:
        for seed in range(5):
            figure = make(np.random.default_rng(seed))
            points = np.concatenate(
                [part.mesh.triangles.reshape(-1, 3) + np.float32([part.ahead, 0, 0]) for part in figure.parts]
            )
            assert np.abs(points[:, 0]).max() <= figure.half_length + 0.3
            assert np.abs(points[:, 0]).max() >= figure.half_length - 0.4
            assert np.abs(points[:, 1]).max() <= figure.half_width + 0.02
            assert -0.02 <= points[:, 2].min() <= 0.05  # it stands on the ground
            assert height[0] < points[:, 2].max() < height[1]
