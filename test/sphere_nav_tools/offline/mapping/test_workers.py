import os
import sys
from types import SimpleNamespace

import pytest

from sphere_nav_tools.offline.mapping.workers import Workers

HERE = os.path.realpath("/proc/self")
ASKED = ["/proc/self"] * 6


def test_one_job_is_done_here():
    with Workers() as workers:
        assert workers.executor is None
        assert list(workers.run(os.path.realpath, ASKED)) == [HERE] * 6


@pytest.mark.slow
def test_several_jobs_are_done_in_other_processes_but_a_lone_piece_is_not():
    with Workers(2) as workers:
        assert list(workers.run(os.path.realpath, ASKED[:1])) == [HERE]
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


@pytest.mark.slow
def test_a_worker_of_a_cluster_that_is_gone_is_one_line():
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(**options) as cluster,
        pytest.raises(OSError, match=r"^--scheduler: expected workers to the end, found one gone: KilledWorker$"),
        Workers(scheduler=cluster.scheduler_address) as workers,
    ):
        list(workers.run(os._exit, [1, 1]))


def test_without_dask_or_a_scheduler_it_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"^--scheduler: expected the package distributed, found none: pip install"):
        Workers(scheduler="tcp://nowhere:1")

    def refuse(address, timeout):
        raise OSError(f"timed out after {timeout:g} s")

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=refuse))
    with pytest.raises(
        ValueError, match=r"^--scheduler tcp://nowhere:1: expected a Dask scheduler, found none: timed out"
    ):
        Workers(scheduler="tcp://nowhere:1")
