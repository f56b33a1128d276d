"""Pixels of key spheres chosen by another thread (M15 eq. 16), before those chosen for an earlier image are too old.

What works beside the images of a live camera takes one core: one thread at a time, the urgent one first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Condition
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.photometric import Reference, RegistrationParams
from sphere_nav.photometric.pixels.pyramid import level_cameras
from sphere_nav.photometric.pixels.selection import Chosen, holds, image_speed, select_levels


class Background:
    """Whose turn it is. The images' own thread asks for none: with two cores, one is free when an image comes."""

    def __init__(self, *, is_limited: bool) -> None:
        """Unless it `is_limited`, all work at once."""
        self._is_limited, self._change = is_limited, Condition()
        self._is_busy, self._num_urgent = False, 0

    @contextmanager
    def work(self, *, is_urgent: bool = False) -> Iterator[None]:
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


EARLY = 0.05  # of the image's width: motion after which pixels are chosen anew; half of what they serve for
SOON_S, LEAD = 0.1, 0.075  # s, when the camera will be where pixels are chosen; motion by then, at most


class PixelsAhead:
    """Choices that are under way, one at a time of a key sphere and the number of views that it will be one of."""

    def __init__(self, params: RegistrationParams, *, is_live: bool) -> None:
        """Of an `is_live` camera a choice is used once it is there; others wait for it, so that runs are equal."""
        self._params, self._is_live = params, is_live
        self.background = Background(is_limited=is_live)  # what other threads of the localiser share with this one
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
            self.use(sphere_id)  # no image may have asked for it yet, and it ages
        pixels, number = reference.level_like(camera), self._params.max_pixels // num_views
        if (sphere_id, num_views) in self._pending:
            return
        speed = image_speed(pixels, twist, camera, number)
        T_soon = SE3.exp(-twist * (min(SOON_S, LEAD / speed) if speed > 0 else SOON_S)) @ T_camera_reference
        if not holds(pixels, T_soon, camera, number, EARLY):
            args = reference, T_soon, camera, num_views
            self._pending[sphere_id, num_views] = reference, self._thread.submit(self._choose_next, *args)
            for level in reference.levels if self._is_live else ():
                level.under_way.add(number)

    def _choose_next(self, *args: Any) -> list[Chosen]:
        with self.background.work(is_urgent=True):
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
        """Take a choice out of those under way."""
        reference, future = self._pending.pop(key)
        for level in reference.levels:
            level.under_way.discard(self._params.max_pixels // key[1])
        return future
