"""The comparison of two versions' results: what it calls a difference, and what digests depend on."""

import copy
import importlib.util
import json

import numpy as np
import pytest

from architecture.tree import ROOT


def script(name):
    """Return a module of scripts/, which is not installed."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


compare_results = script("compare_results")


@pytest.fixture
def record():
    figures = {"map /map/graph": 1, "poses, last line": "1.5 0 0 0"}
    done = {"digests": {"poses": "a" * 64, "map /map/graph": "b" * 64}, "figures": figures, "seconds": 1.0}
    return {
        "inputs": {"town": "c" * 64},
        "cases": {"kitchen": done, "stereo": {"skipped": "no folder", "seconds": 0.0}},
    }


def compare(folder, before, after, *options):
    for name, content in (("before", before), ("after", after)):
        (folder / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    return compare_results.main(["compare", str(folder / "before.json"), str(folder / "after.json"), *options])


def test_equal_records_are_equal_whatever_the_time(record, tmp_path, capsys):
    after = copy.deepcopy(record)
    after["cases"]["kitchen"]["seconds"] = 2.0
    assert compare_results.differences(record, after) == []
    assert compare(tmp_path, record, after) == 0
    said = capsys.readouterr().out
    assert "equal (2 digests)" in said
    assert "skipped: no folder" in said


def test_a_digest_that_differs_is_named(record, tmp_path, capsys):
    after = copy.deepcopy(record)
    after["cases"]["kitchen"]["digests"]["map /map/graph"] = "d" * 64
    after["cases"]["kitchen"]["figures"]["map /map/graph"] = 2
    row = ["kitchen", "map /map/graph", f"{'b' * 12} (1)", f"{'d' * 12} (2)"]
    assert compare_results.differences(record, after) == [row]
    assert compare(tmp_path, record, after) == 1
    assert f"| {' | '.join(row)} |" in capsys.readouterr().out


def test_a_case_of_one_side_is_a_difference(record):
    after = copy.deepcopy(record)
    after["cases"]["stereo"] = after["cases"].pop("kitchen")
    assert compare_results.differences(record, after) == [
        ["kitchen", "", "done", "not recorded"],
        ["stereo", "", "skipped: no folder", "done"],
    ]


def test_nothing_compared_is_not_equal(record, tmp_path, capsys):
    del record["cases"]["kitchen"]
    assert compare(tmp_path, record, record) == 1
    assert "NOTHING COMPARED" in capsys.readouterr().out


class TestDigest:
    """Of messages: every value counts, but for those that are no results."""

    @pytest.fixture
    def inside(self):
        pytest.importorskip("rclpy")
        return script("inside_environment")

    def digest(self, inside, *messages, kind):
        topic = inside.TopicDigest(kind)
        for message in messages:
            topic.add(message)
        return topic.result()["sha256"]

    def test_computing_time_does_not_count_but_all_else_does(self, inside):
        from sphere_nav_msgs.msg import LocalizationStatus

        def digest(**fields):
            return self.digest(inside, LocalizationStatus(**fields), kind="sphere_nav_msgs/msg/LocalizationStatus")

        assert digest(milliseconds=1.0) == digest(milliseconds=2.0)
        others = [digest(value=1.0), digest(limit=1.0), digest(state="LOST"), digest(references=[1]), digest()]
        assert len(set(others)) == len(others)

    def test_one_bit_of_a_pixel_counts(self, inside):
        from sensor_msgs.msg import Image

        def digest(*levels):
            return self.digest(inside, Image(data=bytes(levels)), kind="sensor_msgs/msg/Image")

        assert digest(1, 2, 3) == digest(1, 2, 3)
        assert digest(1, 2, 3) != digest(1, 2, 2)

    def test_one_ulp_counts_and_so_does_the_sign_of_zero(self, inside):
        from geometry_msgs.msg import Twist, Vector3

        def digest(x):
            return self.digest(inside, Twist(linear=Vector3(x=x)), kind="geometry_msgs/msg/Twist")

        assert digest(1.0) != digest(float(np.nextafter(1.0, 2.0)))
        assert digest(0.0) != digest(-0.0)
        assert digest(float("nan")) == digest(float("nan"))

    def test_messages_go_by_their_stamps(self, inside):
        from builtin_interfaces.msg import Time
        from sensor_msgs.msg import Imu
        from std_msgs.msg import Header

        early, late = (Imu(header=Header(stamp=Time(sec=sec))) for sec in (1, 2))
        kind = "sensor_msgs/msg/Imu"
        assert self.digest(inside, early, late, kind=kind) == self.digest(inside, late, early, kind=kind)
        assert self.digest(inside, early, kind=kind) != self.digest(inside, late, kind=kind)


def test_a_file_that_is_no_record_is_refused_in_one_line(tmp_path, capsys):
    for text in [None, "", "[]", '{"cases": 3}', "{}"]:
        path = tmp_path / "a.json"
        if text is not None:
            path.write_text(text)
        assert compare_results.main(["compare", str(path), str(path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"compare_results.py: {path}: expected a record of this script, found: ")
        assert said.count("\n") == 1
