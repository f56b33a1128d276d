"""The summary at the end of a file and the one made by reading it through are the same."""

import pytest

from sphere_nav.ros.bags import BagError
from sphere_nav.ros.bags.mcap_summary import read_summary, scan


def test_both_ways_lead_to_the_same(make_bag):
    path = make_bag() / "bag_0.mcap"
    with path.open("rb") as stream:
        told = read_summary(stream, path.stat().st_size)
        found, loose = scan(stream, path.stat().st_size)
    assert loose == []
    assert found.channels == told.channels
    assert found.schemas == told.schemas
    assert [index.chunk_start_offset for index in found.chunk_indexes] == [
        index.chunk_start_offset for index in told.chunk_indexes
    ]
    assert found.statistics.channel_message_counts == told.statistics.channel_message_counts
    assert found.statistics.message_start_time == told.statistics.message_start_time
    assert found.statistics.message_end_time == told.statistics.message_end_time


def test_a_summary_that_lies_elsewhere(make_bag, tmp_path):
    data = bytearray((make_bag() / "bag_0.mcap").read_bytes())
    path = tmp_path / "x"
    for start in (3, len(data), 2**63):
        data[-8 - 20 : -8 - 12] = start.to_bytes(8, "little")
        path.write_bytes(data)
        with path.open("rb") as stream, pytest.raises(BagError, match="damaged summary: expected it before"):
            read_summary(stream, len(data))
    with path.open("rb") as stream, pytest.raises(BagError, match="expected a footer, found a file of 30"):
        read_summary(stream, 30)
