"""What the end-to-end benchmark computes by itself; its rows are the commands."""

import pytest

from benchmarks.real.end_to_end import splits


@pytest.mark.parametrize("seed", [0, 77, 4177])
@pytest.mark.parametrize("is_quick", [True, False])
def test_frames_that_are_localised_were_not_mapped_and_are_of_the_recording(seed, is_quick):
    for split in splits(seed, is_quick=is_quick):
        mapped, localised = (set(range(*map(int, words.split(":")))) for words in (split.mapped, split.localised))
        assert not mapped & localised
        assert max(mapped | localised) < 360
        assert len(localised) >= 40
