"""The steps of `map` that need no bag: where the map lies, what it says of itself, what is missing."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping import learning, plan, thinning
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


class Finished:
    """The end of a drive in stand-ins: what is written, and what is said of it."""

    def __init__(self, monkeypatch, folder, replaced):
        self.written, self.told, self.folder = [], [], folder
        (folder / "map.mcap").write_bytes(bytes(1_200_000))
        index, other = object(), object()
        self.indices = index, other
        graph = SphereGraph([KeySphere(0, 0, SE3.identity())])
        mapper = SimpleNamespace(
            close_loops=lambda run: self.told.append("loops"), num_loops=2, origin="", appearance=index,
            params=SimpleNamespace(key=SimpleNamespace(merge=True)), graph=graph,
            load_sphere=lambda sphere_id: SimpleNamespace(camera=Spherical(8, 4)),
        )  # fmt: skip
        trajectory = SimpleNamespace(moved=lambda T: SimpleNamespace(positions=np.zeros((1, 3))))
        self.drive = SimpleNamespace(
            mapper=mapper, trajectory=lambda is_base: trajectory,
            anchor_graph=lambda *words: (SE3.identity(), graph, ["warned"]),
            summary=lambda truth: ["2 loops"], loss="", kind="rgbd",
        )  # fmt: skip
        monkeypatch.setattr(learning, "truth_of", lambda bag: None)
        monkeypatch.setattr(thinning, "merge", lambda *words: SimpleNamespace(graph=graph, replaced=replaced))
        monkeypatch.setattr(learning, "condense", lambda stored, ids: [*stored, *ids])
        monkeypatch.setattr(learning, "details_of", lambda graph, params, *words: words)
        extended = SimpleNamespace(index=other, told="joined", new={0})
        monkeypatch.setattr(learning, "extend", lambda base, mapper, locator, start, run: extended)
        monkeypatch.setattr(
            learning,
            "write_stored",
            lambda path, graph, details, index, stored, **_: self.written.append((details, index, tuple(stored))),
        )

    def run(self, base=None, **values):
        words = {"no_loops": False, "trajectory": None, "taught": None, "output": self.folder} | values
        words |= {"experience": "night", "budget": None, "start": None, "overwrite": False}
        workers, mapped = SimpleNamespace(run=map), SimpleNamespace(stored=lambda: ("own",))
        return learning.finish_map(arguments(**words), self.drive, mapped, base, workers, "name: ring")


def test_what_is_finished_is_written_and_told(monkeypatch, tmp_path, capsys):
    end = Finished(monkeypatch, tmp_path, {5: 0, 6: 0})
    assert end.run() == 0
    assert end.told == ["loops"]
    details = "drive", "map", "name: ring", "the true poses of the drive"
    assert end.written == [(details, end.indices[0], ("own",))]
    made = f"map: {tmp_path}, 1.2 MB; its frame: the true poses of the drive"
    said = ["2 loops", "2 key spheres merged with others of their places", "warned", made]
    assert capsys.readouterr().out.splitlines() == said


def test_an_extension_keeps_what_the_map_has_stored(monkeypatch, tmp_path, capsys):
    end = Finished(monkeypatch, tmp_path, {})
    info = SimpleNamespace(source="first", header=SimpleNamespace(frame_id="site"))
    base = SimpleNamespace(graph=SimpleNamespace(nodes=[0]), stored=lambda: ("stored",), info=info, origin="a mast")
    assert end.run(learning.Base(base, SimpleNamespace()), no_loops=True) == 0
    (experience,) = {node.experience for node in end.drive.mapper.graph}
    assert (experience.name, experience.camera, experience.drive) == ("night", "rgbd 8 x 4", "drive")
    assert end.told == []
    details = "first + drive", "site", "name: ring", "a mast"
    assert end.written == [(details, end.indices[1], ("stored", "own"))]
    said = ["2 loops", "joined", "warned", f"map: {tmp_path}, 1.2 MB; its frame: a mast"]
    assert capsys.readouterr().out.splitlines() == said
