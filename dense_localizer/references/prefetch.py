"""Key spheres and their pixels, prepared by other threads before an image needs them.

Spheres are read and prepared within so much memory; pixels are chosen (M15 eq. 16) before those chosen for an earlier
image are too old. What is prepared does not depend on when; only the images' own thread decides what is kept, in the
order of its wishes. What works beside the images of a live camera takes one core: one thread at a time, the urgent one
first.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Condition
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import MIN_SPHERES, PIXELS_AGE, PIXELS_LEAD, PIXELS_LEAD_S
from sphere_nav.geometry import SE3, Camera
from sphere_nav.photometric import Reference, RegistrationParams
from sphere_nav.photometric.pixels.pyramid import level_cameras
from sphere_nav.photometric.pixels.selection import Chosen, holds, image_speed, select_levels

Prepare = Callable[[int], Reference]


class BackgroundTurns:
    """Whose turn it is. The images' own thread asks for none: with two cores, one is free when an image comes."""

    def __init__(self, *, is_limited: bool) -> None:
        """Unless it `is_limited`, all work at once."""
        self._is_limited, self._change = is_limited, Condition()
        self._is_busy, self._num_urgent = False, 0

    @contextmanager
    def wait_for_turn(self, *, is_urgent: bool = False) -> Iterator[None]:
        """Wait for the turn, and have it within the block."""
        if not self._is_limited:
            yield
            return
        with self._change:
            self._num_urgent += is_urgent
            self._change.wait_for(lambda: not self._is_busy and (is_urgent or not self._num_urgent))
            self._num_urgent -= is_urgent
            self._is_busy = True
        try:
            yield
        finally:
            with self._change:
                self._is_busy = False
                self._change.notify_all()


class PixelPrefetch:
    """Choices that are under way, one at a time of a key sphere and the number of views that it will be one of."""

    def __init__(self, params: RegistrationParams, *, is_live: bool) -> None:
        """Of an `is_live` camera a choice is used once it is there; others wait for it, so that runs are equal."""
        self._params, self._is_live = params, is_live
        self.background = BackgroundTurns(is_limited=is_live)  # what other threads of the localizer share with this one
        self._pending: dict[tuple[int, int], tuple[Reference, Future[list[Chosen]]]] = {}
        self._thread = ThreadPoolExecutor(1, "choose_pixels")

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def choose(self, reference: Reference, T_camera_reference: SE3, camera: Camera, num_views: int) -> list[Chosen]:
        """Return the pixels of all levels for a camera that aligns to so many views."""
        pyramid = self._params.pyramid
        cameras = level_cameras(camera, pyramid.num_levels, pyramid.min_side)
        cameras = cameras[min(pyramid.finest, len(cameras) - 1) :]
        return select_levels(reference, T_camera_reference, cameras, self._params.max_pixels // num_views)

    def begin(
        self,
        sphere_id: int,
        reference: Reference,
        T_camera_reference: SE3,
        twist: NDArray[np.float64],
        camera: Camera,
        num_views: int,
    ) -> None:
        """Have the pixels of a key sphere chosen where those that are there will soon be too old; return at once.

        They are chosen for where a camera of this velocity (6,) will be then, but not so far ahead that they would not
        serve the next image.
        """
        if self._is_live:
            self.use(sphere_id)  # no image may have needed it yet, and it ages
        pixels, number = reference.level_like(camera), self._params.max_pixels // num_views
        if (sphere_id, num_views) in self._pending:
            return
        speed = image_speed(pixels, twist, camera, number)
        T_soon = (
            SE3.exp(-twist * (min(PIXELS_LEAD_S, PIXELS_LEAD / speed) if speed > 0 else PIXELS_LEAD_S))
            @ T_camera_reference
        )
        if not holds(pixels, T_soon, camera, number, PIXELS_AGE):
            args = reference, T_soon, camera, num_views
            self._pending[sphere_id, num_views] = reference, self._thread.submit(self._choose_next, *args)
            for level in reference.levels if self._is_live else ():
                level.under_way.add(number)

    def _choose_next(self, *args: Any) -> list[Chosen]:
        with self.background.wait_for_turn(is_urgent=True):
            return self.choose(*args)

    def use(self, sphere_id: int) -> None:
        """Use what was chosen of a key sphere from now on."""
        for key in [key for key in self._pending if key[0] == sphere_id]:
            if self._pending[key][1].done() or not self._is_live:
                for chosen in self._end(key).result():
                    chosen.keep()

    def forget(self, but: Collection[int]) -> None:
        """Forget what was begun of other key spheres than these."""
        for key in [key for key in self._pending if key[0] not in but]:
            self._end(key).cancel()

    def _end(self, key: tuple[int, int]) -> Future[list[Chosen]]:
        """Remove a choice from those under way."""
        reference, future = self._pending.pop(key)
        for level in reference.levels:
            level.under_way.discard(self._params.max_pixels // key[1])
        return future


class SpherePrefetch:
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
        return max(MIN_SPHERES, int(self._memory_bytes // self._largest)) if self._largest else MIN_SPHERES

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

    def _future(self, sphere_id: int, prepare: Prepare | None = None) -> Future[Reference]:
        if sphere_id not in self._references:
            self._references[sphere_id] = self._thread.submit(prepare or self._prepare, sphere_id)
        self._references.move_to_end(sphere_id)
        while len(self._references) > self.capacity:
            self._references.popitem(last=False)[1].cancel()
        return self._references[sphere_id]
