"""The steps of `map` that need no bag: where the map lies, what it says of itself, what is missing."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from sphere_nav.ros.bags import BagError
from sphere_nav_tools.offline.mapping import plan
from sphere_nav_tools.offline.mapping.plan import stitcher_values


def arguments(**values):
    return SimpleNamespace(
        **({"anchor": "truth", "bag": Path("here/drive"), "rig": None, "jobs": 1, "scheduler": ""} | values)
    )


def test_cameras_need_the_file_of_their_rig():
    with pytest.raises(BagError, match="drive: expected --rig with the rig file of its cameras, found none"):
        stitcher_values(SimpleNamespace(path="drive"), {}, arguments())


def test_the_stitcher_of_a_bag_has_the_processes_of_the_command_and_waits_for_late_images(tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "read_rig", lambda path: SimpleNamespace(names=("a", "b")))
    monkeypatch.setattr(plan.topics, "find_rig_topics", lambda bag, names, chosen: dict.fromkeys(names, "/x"))
    given = arguments(rig=tmp_path / "rig.yaml", set_stitcher={"stitch.width": 256, "jobs": 9})
    values, remap = stitcher_values(SimpleNamespace(path="drive"), {}, given)
    assert remap == {"a": "/x", "b": "/x"}
    assert values == {
        "sync.deadline_s": 10.0, "stitch.width": 256, "rig": str(tmp_path / "rig.yaml"), "transport": "raw", "jobs": 2,
    }  # fmt: skip
    given.set_stitcher = {"sync.deadline_s": 3.0}
    assert stitcher_values(SimpleNamespace(path="drive"), {}, given)[0]["sync.deadline_s"] == 3.0
    given.jobs = 2
    assert stitcher_values(SimpleNamespace(path="drive"), {}, given)[0]["jobs"] == 1  # beside another process
