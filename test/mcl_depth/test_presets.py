"""Which preset a cloud gets, and that it changes only what nobody set."""

from __future__ import annotations

import numpy as np

from mcl_depth.params import FilterParams
from mcl_depth.site import PRESETS, apply_preset
from sphere_nav.params import build, to_mapping

ROOM = (np.zeros(3), np.array([9.0, 6.0, 2.6]))
CORRIDOR = (np.zeros(3), np.array([160.0, 5.0, 2.6]))
TOWN = (np.zeros(3), np.array([140.0, 120.0, 20.0]))


def test_the_cloud_tells_the_surroundings():
    for box, name in [(ROOM, "indoor"), (CORRIDOR, "indoor"), (TOWN, "outdoor")]:
        found = apply_preset(FilterParams(), box)
        assert found.preset == name
        values = to_mapping(found)
        assert {key: values[key] for key in PRESETS[name]} == PRESETS[name]


def test_what_was_set_stays_and_what_was_chosen_is_used():
    given = build(FilterParams, {"preset": "outdoor", "area.step": 1.0})
    found = apply_preset(given, ROOM)
    assert (found.area.step, found.cache.max_distance) == (1.0, 0.5)
