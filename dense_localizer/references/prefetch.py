"""Key spheres and their pixels, prepared by other threads before an image needs them.

Spheres are read and prepared within so much memory; pixels are chosen (M15 eq. 16) before those chosen for an earlier
image are too old. What is prepared does not depend on when; of spheres only the images' own thread decides what is
kept, in the order of its wishes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from dense_localizer.constants import MIN_SPHERES, PIXELS_AGE
from sphere_nav.geometry import SE3, Camera
from sphere_nav.photometric import Reference, RegistrationParams
from sphere_nav.photometric.pixels.pyramid import level_cameras
from sphere_nav.photometric.pixels.reference import holds, renew_selection

Wanted = tuple[Reference, SE3, int]  # where it is from the camera, how many pixels


class PixelPrefetch:
    """The pixels of the key spheres in use, and of the next ones, chosen where the camera will soon be."""

    def __init__(self, params: RegistrationParams, *, is_live: bool) -> None:
        """Of an `is_live` camera no image waits for a choice; others do, so that runs are equal."""
        self._params, self._is_live = params, is_live
        self._thread = ThreadPoolExecutor(1, "choose_pixels")
        self._last = Future[None]()
        self._last.set_result(None)

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def begin(self, wanted: Iterable[Wanted], camera: Camera) -> None:
        """Have those pixels for a camera chosen anew that will soon be too old; return at once.

        One choice after the other: what is due while one is under way is asked for again with the next image of a live
        camera; others wait.
        """
        if self._is_live and not self._last.done():
            return
        self._last.result()  # raises what it has raised
        due = [one for one in wanted if not holds(one[0].level_like(camera), one[1], camera, one[2], PIXELS_AGE)]
        if due:
            pyramid = self._params.pyramid
            cameras = level_cameras(camera, pyramid.num_levels, pyramid.min_side)
            self._last = self._thread.submit(self._choose, due, cameras[min(pyramid.finest, len(cameras) - 1) :])

    def wait(self) -> None:
        """Wait for what is being chosen, if images do."""
        if not self._is_live:
            self._last.result()

    @staticmethod
    def _choose(due: Sequence[Wanted], cameras: Sequence[Camera]) -> None:
        for reference, T_camera_reference, number in due:
            for camera in cameras:
                renew_selection(reference.level_like(camera), T_camera_reference, camera, number)


class SpherePrefetch:
    """Prepared references by id of their sphere: the latest used, as many of the largest as `memory_bytes` hold."""

    def __init__(self, prepare: Callable[[int], Reference], memory_bytes: float, *, is_live: bool = False) -> None:
        """Of an `is_live` camera, what is not wanted any more is not begun; others read the same whatever the pace."""
        self._prepare, self._memory_bytes, self._is_live = prepare, memory_bytes, is_live
        self._references: OrderedDict[int, Future[Reference]] = OrderedDict()
        self._largest = 0  # bytes, of those that were got
        self._thread = ThreadPoolExecutor(1, "prepare_spheres")

    @property
    def capacity(self) -> int:
        """How many spheres there is room for."""
        return max(MIN_SPHERES, int(self._memory_bytes // self._largest)) if self._largest else MIN_SPHERES

    @property
    def _ready(self) -> list[Reference]:
        done = [future for future in self._references.values() if future.done() and not future.cancelled()]
        return [future.result() for future in done if future.exception() is None]

    def begin(self, sphere_ids: Sequence[int]) -> None:
        """Have spheres prepared that will be needed soon; return at once.

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
            self.request(sphere_id)

    def request(self, sphere_id: int) -> None:
        """Have one more sphere prepared; return at once."""
        self._future(sphere_id)

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

    def close(self) -> None:
        """End the thread; what is being prepared is the last."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _future(self, sphere_id: int) -> Future[Reference]:
        if sphere_id not in self._references:
            self._references[sphere_id] = self._thread.submit(self._prepare, sphere_id)
        self._references.move_to_end(sphere_id)
        while len(self._references) > self.capacity:
            self._references.popitem(last=False)[1].cancel()
        return self._references[sphere_id]
