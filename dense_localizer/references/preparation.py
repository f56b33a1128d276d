"""Key spheres read and prepared by a second thread, ahead of the image that needs them, within so much memory.

What is prepared does not depend on when. Only the images' own thread decides what is kept, in the order of its wishes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from sphere_nav.photometric import Reference

Prepare = Callable[[int], Reference]
MIN_KEPT = 3  # key spheres that are kept whatever they take: two in use, and the next


class Preparation:
    """Prepared references by id of their sphere: the latest used, as many of the largest as `memory_bytes` hold."""

    def __init__(self, prepare: Prepare, memory_bytes: float, *, is_live: bool = False) -> None:
        """Of an `is_live` camera, what is not wanted any more is not begun; others read the same whatever the pace."""
        self._prepare, self._memory_bytes, self._is_live = prepare, memory_bytes, is_live
        self._references: OrderedDict[int, Future[Reference]] = OrderedDict()
        self._largest = 0  # bytes, of those that were got
        self._thread = ThreadPoolExecutor(1, "prepare_spheres")

    @property
    def capacity(self) -> int:
        """How many spheres there is room for."""
        return max(MIN_KEPT, int(self._memory_bytes // self._largest)) if self._largest else MIN_KEPT

    @property
    def num_bytes(self) -> int:
        """Memory of what is prepared."""
        return sum(reference.num_bytes for reference in self._ready)

    @property
    def _ready(self) -> list[Reference]:
        done = [future for future in self._references.values() if future.done() and not future.cancelled()]
        return [future.result() for future in done if future.exception() is None]

    def begin(self, sphere_ids: list[int], how: Callable[[int], Prepare]) -> None:
        """Have spheres prepared that will be needed soon, `how` says of each by what; return at once.

        The first ones first, and no more than there is room for; what is longest unused makes room.
        """
        if self._is_live:  # what cameras have seen of a sphere since it was got counts, too; it depends on the pace
            self._largest = max([self._largest, *(reference.num_bytes for reference in self._ready)])
        wanted = sphere_ids[: self.capacity]
        if self._is_live:
            for sphere_id, future in list(self._references.items()):
                if sphere_id not in wanted and future.cancel():
                    del self._references[sphere_id]
        for sphere_id in wanted:
            self._future(sphere_id, how(sphere_id))

    def get(self, sphere_id: int) -> Reference:
        """Return a prepared sphere as soon as it is ready; raises what reading it raised, and reads again next time."""
        try:
            reference = self._future(sphere_id).result()
        except (ValueError, OSError):
            del self._references[sphere_id]
            raise
        self._largest = max(self._largest, reference.num_bytes)
        return reference

    def find(self, sphere_id: int) -> Reference | None:
        """Return a sphere that was begun before, of a live camera if it is ready; None for one that cannot be read."""
        future = self._references.get(sphere_id)
        if future is None or (self._is_live and not future.done()) or future.exception() is not None:
            return None
        return future.result()

    def is_ready(self, sphere_id: int) -> bool:
        """Say whether `get` would return, or raise, at once."""
        return sphere_id in self._references and self._references[sphere_id].done()

    def forget(self, sphere_id: int) -> None:
        """Have a sphere prepared anew when it is asked for next."""
        self._references.pop(sphere_id, None)

    def close(self) -> None:
        """End the thread; what is being prepared is the last."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _future(self, sphere_id: int, prepare: Prepare | None = None) -> Future[Reference]:
        if sphere_id not in self._references:
            self._references[sphere_id] = self._thread.submit(prepare or self._prepare, sphere_id)
        self._references.move_to_end(sphere_id)
        while len(self._references) > self.capacity:
            self._references.popitem(last=False)[1].cancel()
        return self._references[sphere_id]
