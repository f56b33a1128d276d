"""The comparison of two versions' results: what it calls a difference, and what digests depend on."""

import copy
import importlib.util
import json

import pytest

from architecture.tree import ROOT


def script(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


compare_results = script("compare_results")


@pytest.fixture
def record():
    done = {"digests": {"poses": "a" * 64, "map /map/graph": "b" * 64}}
    return {"inputs": "c" * 64, "cases": {"kitchen": done, "stereo": {"skipped": "no folder"}}}


def compare(folder, before, after, *options):
    for name, content in (("before", before), ("after", after)):
        (folder / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    return compare_results.main(["compare", str(folder / "before.json"), str(folder / "after.json"), *options])


def test_a_digest_that_differs_is_named_or_left_out_by_a_pattern(record, tmp_path, capsys):
    after = copy.deepcopy(record)
    after["cases"]["kitchen"]["digests"]["map /map/graph"] = "d" * 64
    row = ["kitchen", "map /map/graph", "b" * 12, "d" * 12]
    assert compare_results.differences(record, after) == [row]
    assert compare(tmp_path, record, after) == 1
    assert " | ".join(row) in capsys.readouterr().out
    assert compare_results.differences(record, after, ["kitchen map*"]) == []
