"""Pixels of key spheres chosen by another thread (M15 eq. 16), before those chosen for an earlier image are too old."""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor

from photometric import Reference, RegistrationParams
from photometric.pyramid import level_cameras
from photometric.selection import Chosen, holds, select_levels
from sphere_geometry import SE3, Camera

EARLY = 0.05  # of the image's width: motion after which pixels are chosen anew; half of what they serve for


class PixelsAhead:
    """Choices that are under way, one of a key sphere at a time."""

    def __init__(self, params: RegistrationParams, *, is_live: bool) -> None:
        """Of an `is_live` camera a choice is used once it is there; others wait for it, so that runs are equal."""
        self._params, self._is_live = params, is_live
        self._pending: dict[int, Future[list[Chosen]]] = {}
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
        self, sphere_id: int, reference: Reference, T_camera_reference: SE3, camera: Camera, num_views: int
    ) -> None:
        """Have the pixels of a key sphere chosen where those that are there will soon be too old; return at once."""
        pixels, number = reference.level_like(camera), self._params.max_pixels // num_views
        if sphere_id not in self._pending and not holds(pixels, T_camera_reference, camera, number, EARLY):
            args = reference, T_camera_reference, camera, num_views
            self._pending[sphere_id] = self._thread.submit(self.choose, *args)

    def use(self, sphere_id: int) -> None:
        """Use what was chosen of a key sphere from now on."""
        future = self._pending.get(sphere_id)
        if future is not None and (future.done() or not self._is_live):
            del self._pending[sphere_id]
            for chosen in future.result():
                chosen.keep()

    def forget(self, but: Collection[int]) -> None:
        """Forget what was begun of other key spheres than these."""
        for sphere_id in [key for key in self._pending if key not in but]:
            self._pending.pop(sphere_id).cancel()
