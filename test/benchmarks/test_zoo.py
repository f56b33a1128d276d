"""A spread of the zoo: what `inspect` prints succeeds, what it does not offer is refused in one line."""

from __future__ import annotations

import pytest

from benchmarks.abuse.zoo import Keeper
from benchmarks.abuse.zoo_bags import exhibits

ZOO = {exhibit.name: exhibit for exhibit in exhibits()}
SPREAD = (  # of writers, encodings, names, clocks and faults; `python -m benchmarks zoo` visits all
    "ros1",
    "depth_16UC1_png_compressed",
    "bad_h264",
    "k_is_0",
    "other_info_frame",
    "clock_set_back",
    "recorder_since_boot",
    "odometry_on_tf",
)


@pytest.fixture(scope="module")
def keeper(tmp_path_factory):
    return Keeper(tmp_path_factory.mktemp("zoo"))


def test_the_zoo_is_large_and_its_names_are_different():
    assert len(exhibits()) == len(ZOO) >= 45
    assert set(SPREAD) <= set(ZOO)


@pytest.mark.slow
@pytest.mark.parametrize("name", SPREAD)
def test_every_command_that_inspect_prints_succeeds(name, keeper):
    assert keeper.visit(ZOO[name]).faults == []
