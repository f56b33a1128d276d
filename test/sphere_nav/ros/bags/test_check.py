"""verify_bag finds what is wrong; salvage keeps what is whole."""

import pytest

from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, salvage, verify_bag
from sphere_nav.ros.bags.recorded import BagError


def test_a_damaged_chunk_is_a_problem_and_is_left_out(make_bag, tmp_path):
    path = make_bag()
    file = path / "bag_0.mcap"
    with BagReader(path) as bag:
        index = bag.files[0].summary.chunk_indexes[1]
        expected = list(bag.raw())
    data = bytearray(file.read_bytes())
    data[index.chunk_start_offset + index.chunk_length // 2] ^= 1
    file.write_bytes(data)
    with BagReader(path) as bag:
        number, problems = verify_bag(bag)
    assert number == 21
    assert len(problems) == 1
    assert "bag_0.mcap" in problems[0]
    assert salvage(path, tmp_path / "saved") == 61
    with BagReader(tmp_path / "saved") as bag:
        assert list(bag.raw()) == expected[:21] + expected[41:]


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_truncated_bag_keeps_its_whole_chunks(make_bag, tmp_path, share):
    path = make_bag()
    with BagReader(path) as bag:
        expected = list(bag.raw())
    file = path / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    count = salvage(file, tmp_path / "saved")
    with BagReader(tmp_path / "saved") as bag:
        assert list(bag.raw()) == expected[:count]
        assert bag.topics["/latched"].profile == qos.LATCHED
        assert verify_bag(bag) == (count, [])
    assert count in (21, 41, 61)


def test_where_nothing_can_be_salvaged_it_is_told_and_of_an_sqlite_bag_other_tools_are_named(make_bag, tmp_path):
    file = make_bag() / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(BagError, match="expected a whole chunk to salvage, found none"):
        salvage(file, tmp_path / "saved")
    assert not (tmp_path / "saved").exists()
    with pytest.raises(BagError, match=r"expected an \.mcap file"):
        salvage(tmp_path / "absent", tmp_path / "saved")
    (folder := tmp_path / "other").mkdir()
    (folder / "drive.db3").write_bytes(b"SQLite")
    for path in (folder, folder / "drive.db3"):
        with pytest.raises(BagError, match=r"found sqlite3: .*sqlite3 BAG\.db3 \.recover .* ros2 bag reindex"):
            salvage(path, tmp_path / "saved")
