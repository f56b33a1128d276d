"""Where the pieces of a large work are done: here, in other processes, or on a Dask cluster."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from typing import Any, Self

import cv2

from sphere_mapping.graph.verification import run_in
from sphere_nav_tools.offline.constants import AHEAD

NUM_THREADS = 2  # of the process that registers one sphere after the other
CONNECT_S = 20.0


class Workers:
    """`jobs` processes, made with the first piece of work; or the workers of the cluster at the address `scheduler`.

    `executor` does the work; it is None where all is done in this process.
    """

    def __init__(self, jobs: int = 1, scheduler: str = "") -> None:
        """ValueError where there is no cluster at the address, or Dask is not installed."""
        self._jobs, self._client = jobs, connect(scheduler) if scheduler else None
        self.executor: Executor | None = None
        if self._client is not None:
            self.executor = self._client.get_executor(pure=False)
        elif jobs > 1:
            context = get_context("spawn")  # a fork would inherit half of the threads
            self.executor = ProcessPoolExecutor(jobs, context, begin_worker)

    @property
    def num_ahead(self) -> int:
        """Pieces that are under way at once."""
        number = len(self._client.scheduler_info()["workers"]) if self._client is not None else self._jobs
        return AHEAD * max(number, 1)

    def run(self, function: Callable[[Any], Any], questions: Iterable[Any]) -> Iterator[Any]:
        """Yield the answers to all questions, in order."""
        run = map if self.executor is None else run_in(self.executor, self.num_ahead)
        yield from run(function, questions)

    def _lost(self) -> tuple[type[Exception], ...]:
        """Return what is raised where a worker is gone and no other could do its work."""
        if self._client is None:
            return BrokenExecutor, CancelledError
        from distributed import KilledWorker

        return BrokenExecutor, CancelledError, KilledWorker

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """OSError where workers or their cluster are gone: killed for want of memory, or not answering any more."""
        if isinstance(self.executor, ProcessPoolExecutor):
            for worker in list((self.executor._processes or {}).values()) if kind is not None else ():
                worker.terminate()  # what it works on is of no use any more
            self.executor.shutdown(cancel_futures=True)
        if self._client is not None:  # which has no such shutdown; what is not begun is forgotten with it
            self._client.close()
        if isinstance(error, self._lost()):
            where = "--jobs" if self._client is None else "--scheduler"
            raise OSError(f"{where}: expected workers to the end, found one gone: {type(error).__name__}") from error


def connect(scheduler: str) -> Any:
    """Return the client of a Dask cluster; ValueError in one line where it cannot be reached."""
    try:
        from distributed import Client  # an extra: `pip install sphere_nav[cluster]`
    except ImportError:
        raise ValueError("--scheduler: expected the package distributed, found none: pip install distributed") from None
    try:
        return Client(scheduler, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ValueError(f"--scheduler {scheduler}: expected a Dask scheduler, found none: {error}") from None


def begin_worker() -> None:
    """Leave the cores to the others, Ctrl-C to the process that has made this one, and end with it, however it ends."""
    limit_threads()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def limit_threads(number: int = 1) -> None:
    """Leave the other cores to the other processes."""
    cv2.setNumThreads(number)
