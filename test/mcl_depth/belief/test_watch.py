"""The sequential test of a held place: quiet while it is right, quick when it is not."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.watch import PlaceTest, excess

RATE, NUM_HEADINGS, SIDE = 1e-3, 36, 11


NEAR = np.all(np.abs(np.indices((SIDE, SIDE)) - SIDE // 2) <= 1, axis=0).ravel()  # three by three cells


def curves_of(seed, heading=None, height=0.0):
    curves = np.random.default_rng(seed).normal(0.0, 1.0, (NUM_HEADINGS, SIDE**2)).T.astype(np.float32)
    if heading is not None:
        curves[SIDE**2 // 2, heading] += height
    return curves


def test_a_random_place_stands_out_by_a_standard_deviation_about_zero():
    found = np.array([excess(curves_of(seed), NEAR, seed % NUM_HEADINGS) for seed in range(600)])
    assert found.mean() == pytest.approx(0.0, abs=0.2)
    assert found.std() == pytest.approx(1.0, abs=0.25)


def test_what_stands_out_at_the_heading_is_found_beside_cells_that_are_missing():
    curves = curves_of(1, 35, 9.0)
    assert excess(curves, NEAR, 35) > 5.0
    assert excess(curves, NEAR, 0) > 5.0  # the next heading, across the seam
    assert abs(excess(curves, NEAR, 12)) < 3.0
    assert excess(curves[40:], NEAR[40:], 35) > 5.0


def test_a_street_that_looks_alike_all_along_proves_no_place():
    curves = curves_of(2)
    raised = curves.copy()
    raised[:, 7] += 30.0
    assert excess(raised, NEAR, 7) == pytest.approx(excess(curves, NEAR, 7), abs=1e-3)


def test_a_right_place_is_refused_less_often_than_the_rate():
    rng, alarms, count = np.random.default_rng(3), 0, 0
    for _ in range(60):
        watch = PlaceTest(RATE, is_held=True)
        for value in rng.normal(6.0, 2.0, 300):
            watch.add(float(value))
            count += 1
            if watch.p_chance > 0.5:
                alarms += 1
                watch = PlaceTest(RATE, is_held=True)
    assert alarms <= RATE * count


def test_a_place_that_is_no_more_is_refused_within_a_few_images():
    rng, delays = np.random.default_rng(4), []
    for _ in range(200):
        watch = PlaceTest(RATE, is_held=True)
        for value in rng.normal(6.0, 2.0, 30):
            watch.add(float(value))
        delay = 0
        while watch.p_chance <= 0.5:
            watch.add(float(rng.normal()))
            delay += 1
        delays.append(delay)
    assert min(delays) >= 2  # none ends a place by itself
    assert np.median(delays) <= 5


def test_a_place_on_trial_is_believed_or_refused_after_five_clear_images():
    for value, is_right in ((6.0, True), (0.0, False)):
        trial = PlaceTest(RATE, is_held=False)
        assert trial.p_chance == 0.5
        found = []
        for _ in range(5):
            trial.add(value)
            found.append((trial.p_chance < RATE, trial.is_refused()))
        assert found == [(False, False)] * 4 + [(is_right, not is_right)]


def test_a_trial_learns_nothing_of_its_images_so_that_their_order_does_not_matter():
    found = []
    for values in ((9.0, 3.0, 5.0), (3.0, 5.0, 9.0)):
        trial = PlaceTest(RATE, is_held=False)
        for value in values:
            trial.add(value)
        found.append(trial.p_chance)
    assert 0.0 < found[0] < 0.5
    assert found[0] == pytest.approx(found[1], rel=1e-9)
