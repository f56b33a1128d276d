"""Where the pieces of a large work are done: here, in other processes, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from itertools import chain, islice
from multiprocessing import get_context
from types import TracebackType
from typing import Any, Self

import cv2

from sphere_mapping.acquisition.kernels import use_threads
from sphere_mapping.graph.verification import run_in

NUM_THREADS = 2  # of the process that registers one sphere after the other
AHEAD = 2  # pieces a worker that are under way: one at work, one that waits
CONNECT_S = 20.0


class Workers:
    """`jobs` processes, made with the first piece of work; or the workers of the cluster at the address `scheduler`.

    `executor` is None where all is done in this process.
    """

    def __init__(self, jobs: int = 1, scheduler: str = "") -> None:
        """ValueError where there is no cluster at the address, or Dask is not installed."""
        self._jobs, self._client = jobs, connect(scheduler) if scheduler else None
        self._executor: Executor | None = None

    @property
    def num_ahead(self) -> int:
        """Pieces that are under way at once."""
        number = len(self._client.scheduler_info()["workers"]) if self._client is not None else self._jobs
        return AHEAD * max(number, 1)

    @property
    def executor(self) -> Executor | None:
        """What does the work."""
        if self._executor is None and self._client is not None:
            self._executor = self._client.get_executor(pure=False)
        elif self._executor is None and self._jobs > 1:
            context = get_context("spawn")  # a fork would inherit half of the threads
            self._executor = ProcessPoolExecutor(self._jobs, context, limit_threads)
        return self._executor

    def run(self, function: Callable[[Any], Any], questions: Iterable[Any]) -> Iterator[Any]:
        """Yield the answers to all questions, in order; a lone one is not worth a process."""
        remaining = iter(questions)
        first = list(islice(remaining, 2))
        if len(first) < 2 or self.executor is None:
            return map(function, chain(first, remaining))
        return run_in(self.executor, self.num_ahead)(function, chain(first, remaining))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
        if self._client is not None:
            self._client.close()


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


def limit_threads(number: int = 1) -> None:
    """Leave the other cores to the other processes."""
    cv2.setNumThreads(number)
    use_threads(number)
