"""Key spheres read and prepared by a second thread, ahead of the image that needs them.

What is prepared does not depend on when: an image that comes too early waits, so results are the same however fast
the threads are. Only the images' own thread decides what is kept, in the order of its wishes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor

from photometric import Reference


class Preparation:
    """Prepared references by id of their sphere, the latest used `capacity` of them."""

    def __init__(self, prepare: Callable[[int], Reference], capacity: int) -> None:
        self._prepare, self._capacity = prepare, capacity
        self._references: OrderedDict[int, Future[Reference]] = OrderedDict()
        self._thread = ThreadPoolExecutor(1, "prepare_spheres")

    def begin(self, sphere_ids: Iterable[int]) -> None:
        """Have spheres prepared that will be needed soon; return at once."""
        for sphere_id in sphere_ids:
            self._future(sphere_id)

    def get(self, sphere_id: int) -> Reference:
        """Return a prepared sphere as soon as it is ready; raises what reading it raised, and reads again next time."""
        try:
            return self._future(sphere_id).result()
        except (ValueError, OSError):
            del self._references[sphere_id]
            raise

    def forget(self, sphere_id: int) -> None:
        """Have a sphere prepared anew when it is asked for next."""
        self._references.pop(sphere_id, None)

    def close(self) -> None:
        """End the thread; what is being prepared is the last."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _future(self, sphere_id: int) -> Future[Reference]:
        if sphere_id not in self._references:
            self._references[sphere_id] = self._thread.submit(self._prepare, sphere_id)
            if len(self._references) > self._capacity:
                self._references.popitem(last=False)
        self._references.move_to_end(sphere_id)
        return self._references[sphere_id]
