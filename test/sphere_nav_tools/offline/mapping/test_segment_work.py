"""The record of a segment."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_mapping.graph.keyframes import Track
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3
from sphere_nav_tools.offline.mapping.segment_work import SegmentRecord, read_record, write_record

T = SE3.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
RECORD = SegmentRecord(
    [Track(5, 2, T), Track(7, 3, T.inverse())], 4, 1, {"{n} of /a: no": 3}, ["chunk"], CameraMount("c", True, T, T), "o"
)


def test_a_record_is_read_as_it_was_written(tmp_path):
    write_record(tmp_path / "a.json", RECORD)
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]
    found = read_record(tmp_path / "a.json")
    assert [(one.stamp_ns, one.key_id) for one in found.tracks] == [(5, 2), (7, 3)]
    np.testing.assert_allclose(found.tracks[1].T_key_sphere.matrix, T.inverse().matrix, atol=1e-15)
    assert (found.num_lost, found.num_loops, found.refused, found.damages) == (4, 1, {"{n} of /a: no": 3}, ["chunk"])
    assert (found.mount.frame_id, found.mount.is_optical, found.origin) == ("c", True, "o")
    np.testing.assert_allclose(found.mount.T_sphere_body.matrix, T.matrix, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "expected JSON"), ("[]", "expected the fields stamps"), ("{}", "a.json.stamps: expected a value")],
)
def test_another_file_is_refused_in_one_line(text, message, tmp_path):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_record(tmp_path / "a.json")


def test_a_record_of_other_values_is_refused_in_one_line(tmp_path):
    write_record(tmp_path / "a.json", RECORD)
    text = (tmp_path / "a.json").read_text()
    (tmp_path / "a.json").write_text(text.replace('"stamps": [5, 7]', '"stamps": 5'))
    with pytest.raises(ValueError, match="expected a record of a segment, found another file"):
        read_record(tmp_path / "a.json")
