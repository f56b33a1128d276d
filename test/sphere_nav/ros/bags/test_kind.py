import bz2
import json
import subprocess
import sys

import lz4.frame
import pytest
import zstandard

from sphere_nav.ros.bags.kind import PlainView, compression_of, is_foreign, lone_file
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.recording_sets import SETS, belongs
from sphere_nav.ros.bags.unpack import unpack, unpack_file
from sphere_nav.ros.interfaces import message_class


def test_mcap_is_read_by_ourselves_and_of_a_folder_the_one_database_is_meant(tmp_path):
    for name, description, expected in [
        ("drive.mcap", None, False),
        ("drive.db3", None, True),
        ("drive.bag", None, True),
        ("drive", {"storage_identifier": "sqlite3"}, True),
        ("drive", {"storage_identifier": "mcap", "compression_mode": ""}, False),
        ("drive", {"storage_identifier": "mcap", "compression_mode": "FILE"}, False),
    ]:
        assert is_foreign(tmp_path / name, description) == expected
    (tmp_path / "a.db3").touch()
    (tmp_path / "a.txt").touch()
    assert lone_file(tmp_path) == tmp_path / "a.db3"
    (tmp_path / "b.db3").touch()
    assert lone_file(tmp_path) == tmp_path


@pytest.mark.dds
def test_readers_of_other_bags_and_what_they_need_are_not_loaded_before_there_is_one():
    heavy = "sqlite3", "sphere_nav.ros.bags.foreign", "scipy.special"
    hide = "sys.modules['coverage'] = None"  # with it numba loads sqlite3, whatever we do
    code = f"import sys; {hide}; import dense_localizer.ros.node; print([one for one in {heavy} if one in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "[]"


DESCRIPTION = {"compression_format": "zstd", "compression_mode": "FILE", "relative_file_paths": ["a.db3.zstd"]}


@pytest.fixture
def bag(tmp_path):
    (tmp_path / "a.db3.zstd").write_bytes(zstandard.compress(b"plain"))
    return tmp_path


@pytest.mark.parametrize(("mode", "name", "content"), [("FILE", "a.db3", b"plain"), ("MESSAGE", "a.db3.zstd", None)])
def test_files_are_unpacked_and_packed_messages_stay(bag, mode, name, content):
    view = PlainView(bag, DESCRIPTION | {"compression_mode": mode})
    assert (view.path / name).read_bytes() == (content or (bag / name).read_bytes())
    described = json.loads((view.path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (compression_of(described), described["relative_file_paths"]) == ("none", [name])
    view.close()
    assert not view.path.exists()


def test_a_description_leads_to_no_file_beside_the_bag(bag):
    with pytest.raises(BagError, match="expected zero, found no such file"):
        PlainView(bag, DESCRIPTION | {"relative_file_paths": ["../../a.db3.zstd", "/dev/zero"]})


def test_every_type_of_a_set_exists_and_what_belongs_to_it():
    for kind in sorted(set().union(*SETS.values()) - {"ackermann_msgs/msg/AckermannDriveStamped"}):
        assert message_class(kind)
    for topic, kind, chosen, expected in [
        ("/image_raw", "sensor_msgs/msg/Image", "raw", True),
        ("/image_raw", "sensor_msgs/msg/Image", "control", False),
        ("/status", "sphere_nav_msgs/msg/LocalizationStatus", "localisation", True),
        ("/tf_static", "tf2_msgs/msg/TFMessage", "spheres", True),  # no recording is of use without it
        ("/anything", "std_msgs/msg/String", "all", True),
        ("/_hidden/topic", "std_msgs/msg/String", "all", False),
        ("/image_raw", "sensor_msgs/msg/Image", "", False),
    ]:
        assert belongs(topic, kind, chosen) is expected


PLAIN = bytes(range(256)) * 4


def zstd(data, *, is_told=True):
    return zstandard.ZstdCompressor(write_content_size=is_told).compress(data)


PACK = {"zstd": zstd, "lz4": lz4.frame.compress, "bz2": bz2.compress, "": bytes}


def test_what_was_packed_comes_back_unless_it_is_damaged_or_nobody_knows_the_method():
    for method in PACK:
        assert unpack(PACK[method](PLAIN), method, len(PLAIN)) == PLAIN
    with pytest.raises(BagError, match="compression: expected zstd, lz4, bz2 or none, found 'brotli'"):
        unpack(b"", "brotli", 10)
    for method in ("zstd", "lz4", "bz2"):
        with pytest.raises(BagError, match=f"expected {method} data, found damage"):
            unpack(b"not that", method, 10)
        with pytest.raises(BagError, match=f"expected {method} data, found damage"):
            unpack(PACK[method](PLAIN)[:40], method, len(PLAIN))


def test_a_file_is_unpacked_within_limits(tmp_path, monkeypatch):
    packed, plain = tmp_path / "a.zstd", tmp_path / "a"
    packed.write_bytes(zstd(PLAIN) + zstd(PLAIN))
    unpack_file(packed, plain)
    assert plain.read_bytes() == PLAIN + PLAIN
    monkeypatch.setattr("sphere_nav.ros.bags.unpack.MAX_WINDOW", 1 << 23)
    packed.write_bytes(zstd(bytes(1 << 24)))
    with pytest.raises(BagError, match=r"a\.zstd: expected at most 8388608 bytes after decompression, found more"):
        unpack_file(packed, plain)
    assert plain.stat().st_size <= 1 << 23
    packed.write_bytes(b"not that")
    with pytest.raises(BagError, match=r"a\.zstd: expected zstd data, found damage"):
        unpack_file(packed, plain)
