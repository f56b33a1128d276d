"""The steps of `map` that need no bag: where the map lies, what it says of itself, what is missing."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav.geometry import SE3
from sphere_nav.offline.mapping import learning, replay_mapper
from sphere_nav.offline.mapping.learning import anchor_map, rig_text, start_of
from sphere_nav.offline.mapping.replay_mapper import stitcher_values
from sphere_nav.offline.mapping.truth import Truth
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import KeySphere, SphereGraph

T_FITTED = SE3.from_planar(1.0, 2.0, 0.5)


def drive(T_fitted=T_FITTED):
    graph = SphereGraph([KeySphere(k, k, SE3.from_planar(float(k), 0.0, 0.0)) for k in range(3)])
    mapper = SimpleNamespace(graph=graph)
    node = SimpleNamespace(mapper=mapper, T_base_sphere=SE3.identity())
    return SimpleNamespace(node=node, fit=lambda truth: T_fitted)


def arguments(**values):
    return SimpleNamespace(**({"anchor": "truth", "bag": Path("here/drive"), "rig": None} | values))


def test_a_map_begins_at_its_first_sphere_or_lies_on_the_truth(monkeypatch):
    truth = Truth(None, is_base=False)
    T, graph, warnings = anchor_map(arguments(anchor="first"), drive(), truth)
    assert (T.matrix.tolist(), warnings) == (np.eye(4).tolist(), [])
    assert graph[2].T_map_sphere.translation[0] == 2.0
    T, graph, warnings = anchor_map(arguments(), drive(), truth)
    assert T is T_FITTED
    np.testing.assert_allclose(graph[2].T_map_sphere.matrix, (T_FITTED @ SE3.from_planar(2.0, 0.0, 0.0)).matrix)
    monkeypatch.setattr(learning, "move_to_truth", lambda graph, truth, T: graph.with_poses({0: SE3.identity()}))
    monkeypatch.setattr(learning, "check_survey", lambda aligned, surveyed, source: [source])
    T, graph, warnings = anchor_map(arguments(anchor="survey"), drive(), truth)
    assert warnings == ["here/drive"]
    np.testing.assert_array_equal(graph[0].T_map_sphere.matrix, np.eye(4))
    with pytest.raises(BagError, match="expected poses at the stamps of the spheres, found none"):
        anchor_map(arguments(), drive(None), truth)
    with pytest.raises(BagError, match="here/drive: ground_truth/pose or ground_truth/odometry: expected poses"):
        anchor_map(arguments(), drive(), None)


def test_a_map_names_its_bag_and_keeps_its_rig(tmp_path):
    (tmp_path / "rig.yaml").write_text("name: ring\n")
    begun = start_of(arguments(rig=tmp_path / "rig.yaml"))
    assert (begun.source, begun.rig) == ("drive", "name: ring\n")
    assert rig_text(arguments()) == ""


def test_cameras_need_the_file_of_their_rig():
    with pytest.raises(BagError, match="drive: expected --rig with the rig file of its cameras, found none"):
        stitcher_values(SimpleNamespace(path="drive"), {}, arguments())


def test_the_stitcher_of_a_bag_has_the_processes_of_the_command_and_waits_for_late_images(tmp_path, monkeypatch):
    monkeypatch.setattr(replay_mapper, "read_rig", lambda path: SimpleNamespace(names=("a", "b")))
    monkeypatch.setattr(replay_mapper.topics, "find_rig_topics", lambda bag, names, chosen: dict.fromkeys(names, "/x"))
    given = arguments(rig=tmp_path / "rig.yaml", set_stitcher={"stitch.width": 256, "jobs": 9})
    values, remap = stitcher_values(SimpleNamespace(path="drive"), {}, given)
    assert remap == {"a": "/x", "b": "/x"}
    assert values == {
        "sync.deadline_s": 10.0, "stitch.width": 256, "rig": str(tmp_path / "rig.yaml"), "transport": "raw", "jobs": 2,
    }  # fmt: skip
    given.set_stitcher = {"sync.deadline_s": 3.0}
    assert stitcher_values(SimpleNamespace(path="drive"), {}, given)[0]["sync.deadline_s"] == 3.0


class Finished:
    """The end of a drive in stand-ins: what is written, and what is said of it."""

    def __init__(self, monkeypatch, replaced):
        self.written, self.told = [], []
        index, other = object(), object()
        self.indices = index, other
        mapper = SimpleNamespace(
            keep_end=lambda: self.told.append("end"), close_loops=lambda run: self.told.append("loops"), num_loops=2,
            appearance=index, params=SimpleNamespace(key=SimpleNamespace(merge=True)),
        )  # fmt: skip
        trajectory = SimpleNamespace(moved=lambda T: SimpleNamespace(positions=np.zeros((1, 3))))
        self.drive = SimpleNamespace(
            node=SimpleNamespace(mapper=mapper), trajectory=lambda is_base: trajectory, anchor=lambda truth: None,
            summary=lambda loops, truth, T: [f"{loops} loops"],
        )  # fmt: skip
        graph = SphereGraph([KeySphere(0, 0, SE3.identity())])
        monkeypatch.setattr(learning, "truth_of", lambda bag: None)
        monkeypatch.setattr(learning, "anchor_map", lambda arguments, drive, truth: (SE3.identity(), graph, ["warned"]))
        monkeypatch.setattr(learning, "merge", lambda *words: SimpleNamespace(graph=graph, replaced=replaced))
        monkeypatch.setattr(learning, "complete", lambda *words: "details")
        monkeypatch.setattr(learning, "_size", lambda path: "1 MB")
        extended = SimpleNamespace(index=other, told="joined")
        monkeypatch.setattr(learning, "extend", lambda base, mapper, run: extended)
        self.writer = SimpleNamespace(finish=lambda *words: self.written.append(words[1:]))

    def run(self, base=None, **values):
        words = {"no_loops": False, "trajectory": None, "taught": None, "output": "out"} | values
        workers = SimpleNamespace(run=map)
        return learning.finish_map(arguments(**words), self.drive, self.writer, base, workers)


def test_what_is_finished_is_written_and_told(monkeypatch, capsys):
    end = Finished(monkeypatch, {5: 0, 6: 0})
    assert end.run() == 0
    assert end.told == ["end", "loops"]
    assert end.written == [("details", end.indices[0], ())]
    said = ["2 loops", "2 key spheres merged with others of their places", "warned", "map: out, 1 MB"]
    assert capsys.readouterr().out.splitlines() == said


def test_an_extension_keeps_what_the_map_has_stored(monkeypatch, capsys):
    end = Finished(monkeypatch, {})
    base = SimpleNamespace(graph=SimpleNamespace(nodes=[0]), stored=lambda: ("stored",))
    assert end.run(base, no_loops=True) == 0
    assert end.told == ["end"]
    assert end.written == [("details", end.indices[1], ("stored",))]
    assert capsys.readouterr().out.splitlines() == ["2 loops", "joined", "warned", "map: out, 1 MB"]
