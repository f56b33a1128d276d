"""What missions by a camera are judged by, and that the tour can be driven; a mission is the benchmark itself."""

from itertools import permutations

import numpy as np

from benchmarks.drive.mission_town import PLACES, tour_network
from path_follower.routes.network import Spot
from path_follower.routes.planning import plan


def test_the_tour_is_a_network_with_a_way_from_each_place_to_each_other_one():
    network = tour_network()
    assert sum(edge.length for edge in network.edges.values()) > 1000.0
    assert max(np.abs(edge.curve.bend).max() for edge in network.edges.values()) < 0.25  # 1/m, of 6 m with branches
    places = network.places.keys() & PLACES.keys()
    assert len(places) == 6
    for start, goal in permutations(places, 2):
        here = Spot(network.departures(network.places[start])[0].id, 0.0)
        assert plan(network, [here], network.spots_of(network.places[goal]), cruise=2.0).length > 10.0
