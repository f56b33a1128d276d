"""How old what nodes answer is."""

import pytest

from benchmarks.times.live_rigs import Heard


def test_only_what_was_sent_has_an_age():
    heard = Heard(sent=[10, 20, 30], answers={20: (0.05, "TRACKING"), 30: (0.02, ""), 99: (5.0, "")})
    assert heard.ages_ms == pytest.approx([50.0, 20.0])
