"""A compressed folder is seen as a plain one, in a folder that goes with it; strange descriptions are refused."""

import json

import pytest
import zstandard

from sphere_nav.ros.bags.kind import PlainView, compression_of
from sphere_nav.ros.bags.recorded import BagError

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


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"compression_format": "lz4"}, "expected zstd of files or messages, found lz4 of file"),
        ({"compression_mode": "storage"}, "expected zstd of files or messages, found zstd of storage"),
        ({"relative_file_paths": ["b.db3.zstd"]}, "expected b.db3.zstd, found no such file"),
        ({"relative_file_paths": ["../../a.db3.zstd", "/dev/zero"]}, "expected zero, found no such file"),
        ({"relative_file_paths": 3}, "expected a readable bag"),
    ],
)
def test_what_cannot_be_is_refused(bag, wrong, words):
    with pytest.raises(BagError, match=words):
        PlainView(bag, DESCRIPTION | wrong)
