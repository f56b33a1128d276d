"""The comparison of two versions' results: what it calls a difference, and what digests depend on."""

import json
import sys

from architecture.tree import ROOT

sys.path.append(str(ROOT / "scripts"))  # not installed

import compare_results


def record(graph):
    done = {"digests": {"poses": "a" * 64, "map /map/graph": graph * 64}}
    return {"inputs": "c" * 64, "cases": {"kitchen": done, "stereo": {"skipped": "no folder"}}}


def test_a_digest_that_differs_is_named_or_left_out_by_a_pattern(tmp_path, capsys):
    before, after = record("b"), record("d")
    files = [tmp_path / "before.json", tmp_path / "after.json"]
    for file, content in zip(files, (before, after), strict=True):
        file.write_text(json.dumps(content), encoding="utf-8")
    row = ["kitchen", "map /map/graph", "b" * 12, "d" * 12]
    assert compare_results.differences(before, after) == [row]
    assert compare_results.main(["compare", *map(str, files)]) == 1
    assert " | ".join(row) in capsys.readouterr().out
    assert compare_results.differences(before, after, ["kitchen map*"]) == []
