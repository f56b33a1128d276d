"""The comparison of two versions' results: what it calls a difference, and what digests depend on."""

import copy
import importlib.util
import json

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3
from sensor_msgs.msg import Image, Imu
from sphere_nav_msgs.msg import LocalizationStatus
from std_msgs.msg import Header

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


def test_a_digest_counts_every_bit_but_the_time_of_computing_and_the_order_of_stamps():
    inside = script("inside_environment")

    def digest(*messages):
        kind = type(messages[0])
        topic = inside.TopicDigest(f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}")
        for message in messages:
            topic.add(message)
        return topic.result()["sha256"]

    status = LocalizationStatus
    assert digest(status(milliseconds=1.0)) == digest(status(milliseconds=2.0))
    others = [{"value": 1.0}, {"limit": 1.0}, {"state": "LOST"}, {"references": [1]}, {}]
    assert len({digest(status(**fields)) for fields in others}) == len(others)
    assert digest(Image(data=bytes([1, 2, 3]))) != digest(Image(data=bytes([1, 2, 2])))
    numbers = (1.0, float(np.nextafter(1.0, 2.0)), 0.0, -0.0, float("nan"))
    assert len({digest(Vector3(x=number)) for number in numbers}) == len(numbers)
    early, late = (Imu(header=Header(stamp=Time(sec=sec))) for sec in (1, 2))
    assert digest(early, late) == digest(late, early)
    assert digest(early) != digest(late)


def test_a_file_that_is_no_record_is_refused_in_one_line(tmp_path, capsys):
    for text in [None, "", "[]", '{"cases": 3}', "{}"]:
        path = tmp_path / "a.json"
        if text is not None:
            path.write_text(text)
        assert compare_results.main(["compare", str(path), str(path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"compare_results.py: {path}: expected a record of this script, found: ")
        assert said.count("\n") == 1
