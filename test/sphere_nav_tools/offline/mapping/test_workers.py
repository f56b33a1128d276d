"""Work by other processes, and stitching ahead."""

import os
import sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from sphere_nav_tools.offline.mapping import replay_mapper
from sphere_nav_tools.offline.mapping.replay_mapper import stitcher_values
from sphere_nav_tools.offline.mapping.stitcher_ahead import StitcherAhead
from sphere_nav_tools.offline.mapping.workers import Workers
from worlds.streams import finder_of, image

HERE = os.path.realpath("/proc/self")
ASKED = ["/proc/self"] * 6


@pytest.mark.slow
def test_several_jobs_are_done_in_other_processes():
    with Workers(2) as workers:
        assert list(workers.run(os.path.realpath, [])) == []
        found = list(workers.run(os.path.realpath, ASKED))
        assert len(found) == 6
        assert HERE not in found
        assert list(workers.run(abs, range(-9, 0))) == list(range(9, 0, -1))
        assert workers.num_ahead == 4


@pytest.mark.slow
def test_a_worker_that_is_gone_is_one_line():
    with (
        pytest.raises(OSError, match=r"^--jobs: expected workers to the end, found one gone: BrokenProcessPool$"),
        Workers(2) as workers,
    ):
        list(workers.run(os._exit, [1, 1, 1]))


def test_without_dask_or_a_scheduler_it_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"^--scheduler: expected the package distributed, found none: pip install"):
        Workers(scheduler="tcp://nowhere:1")

    def refuse(address, timeout):
        raise OSError(f"timed out after {timeout:g} s")

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=refuse))
    with pytest.raises(ValueError, match=r"^--scheduler tcp://nowhere:1: expected a Dask scheduler, found none: timed"):
        Workers(scheduler="tcp://nowhere:1")


def make(stitch):
    """Return a stitcher without a rig, and the list of what it publishes."""
    node, published = StitcherAhead.__new__(StitcherAhead), []
    node.pool, node.coming, node._known = ThreadPoolExecutor(1), deque(), b""
    node.stitcher = SimpleNamespace(stitch=stitch, is_settled=False)
    node.publish = published.append
    return node, published


def instant(stamp):
    return SimpleNamespace(images={}, sync=SimpleNamespace(stamp_ns=stamp), points=None, depths=None)


def test_a_sphere_is_published_some_instants_later():
    node, published = make(lambda images, stamp, points, depths: stamp)
    for stamp, before in ((1, []), (2, []), (3, [1]), (4, [1, 2])):
        node.stitch(instant(stamp))
        assert published == before
    while node.coming:
        node.publish_next()
    assert published == [1, 2, 3, 4]


def test_an_instant_that_cannot_be_stitched_is_told_where_its_sphere_is_due():
    def stitch(images, stamp, points, depths):
        raise ValueError("top_left: image: expected 416 x 416")

    node, published = make(stitch)
    node.stitch(instant(1))
    with pytest.raises(ValueError, match="top_left"):
        node.publish_next()
    assert published == []


def test_a_replayed_stitcher_waits_for_late_images_and_shares_its_processes(tmp_path, monkeypatch):
    monkeypatch.setattr(replay_mapper, "read_rig", lambda path: SimpleNamespace(names=("a", "b")))
    finder = finder_of([image(f"/{name}/image_raw", frame=name) for name in ("a", "b")])
    rig, told = tmp_path / "rig.yaml", {"stitch.width": 256, "jobs": 9}
    given = SimpleNamespace(rig=rig, jobs=1, scheduler="", set_stitcher=told)
    values, remap = stitcher_values(finder, given)
    assert remap == {"cameras/a/image_raw": "/a/image_raw", "cameras/b/image_raw": "/b/image_raw"}
    assert values == {
        "sync.deadline_s": 10.0, "stitch.width": 256, "rig": str(tmp_path / "rig.yaml"), "transport": "raw", "jobs": 2,
    }  # fmt: skip
    given.set_stitcher = {"sync.deadline_s": 3.0}
    assert stitcher_values(finder, given)[0]["sync.deadline_s"] == 3.0
    given.jobs = 2
    assert stitcher_values(finder, given)[0]["jobs"] == 1  # beside another process
