"""What nodes say they have lost, and how old what they answer is."""

import pytest

from benchmarks.times.live_rigs import Heard

VALUES = {
    "sphere_stitcher: input cameras/a/image_raw": {"received": "5", "lost": "2"},
    "sphere_stitcher: input cameras/b/image_raw": {"received": "5", "lost": "3"},
    "sphere_stitcher: callbacks": {"lost": "100"},
    "sphere_mapper: input sphere": {"received": "5", "lost": "7"},
    "sphere_mapper: mapping": {"spheres": "11"},
}


def test_losses_are_summed_over_the_inputs_of_a_node():
    heard = Heard(values=VALUES)
    assert [heard.count("sphere_stitcher", what) for what in ("received", "lost")] == [10, 5]
    assert heard.count("sphere_mapper", "lost") == 7


def test_only_what_was_sent_has_an_age():
    heard = Heard(sent=[10, 20, 30], answers={20: (0.05, "TRACKING"), 30: (0.02, ""), 99: (5.0, "")})
    assert heard.ages_ms == pytest.approx([50.0, 20.0])
