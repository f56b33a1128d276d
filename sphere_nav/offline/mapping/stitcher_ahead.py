"""Stitching beside mapping, for recordings; in other processes, too, with what a stitcher has learned of its rig.

A stitcher learns its lenses' falloff from its first instants and checks its rig once; from then on an instant depends
on nothing that was before. Until then the work stays where it is.
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_mapping.acquisition.ros.rig_intake import RigInstant
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.spheres.sphere import Sphere


@dataclass(frozen=True, eq=False)
class StitchTask:
    """What was seen at an instant, as `Stitcher.stitch` takes it, and how the stitcher is made that stitches it."""

    recipe: bytes
    images: Mapping[str, NDArray[np.uint8]]
    stamp_ns: int
    points_rig: NDArray[np.floating[Any]] | None
    depths: Mapping[str, NDArray[np.floating[Any]]] | None


def recipe_of(stitcher: Stitcher) -> bytes:
    """Return how a stitcher that has learned its rig is made anew; ValueError where it still learns."""
    if not stitcher.is_settled:
        raise ValueError(f"rig {stitcher.rig.name}: expected a stitcher that has learned it, found one that learns")
    return pickle.dumps((stitcher.rig, stitcher.params, stitcher.masks, stitcher.learned))


def stitch_task(task: StitchTask) -> Sphere:
    """Return the sphere of an instant, the same bits as the stitcher itself would."""
    return _stitcher(task.recipe).stitch(task.images, task.stamp_ns, task.points_rig, task.depths).sphere


@lru_cache(maxsize=1)
def _stitcher(recipe: bytes) -> Stitcher:
    rig, params, masks, learned = pickle.loads(recipe)
    stitcher = Stitcher(rig, params, masks)
    stitcher.resume(learned)
    return stitcher


class StitcherAhead(SphereStitcher):
    """The stitcher, one instant ahead of the mapper: a sphere is published when the next instant is complete.

    So both work side by side, and the order of all messages is the same on every machine. `coming_from`: where the
    spheres come from, in the order of the instants, if others stitch them.
    """

    coming_from: Iterator[Future[Sphere]] | None = None

    def configure(self) -> None:
        """Open the thread that stitches."""
        self.pool, self.coming = ThreadPoolExecutor(1), deque[Future[Sphere]]()
        super().configure()

    def cleanup(self) -> None:
        """Close the thread; what it has not begun is not stitched any more."""
        self.pool.shutdown(cancel_futures=True)
        super().cleanup()

    def stitch(self, instant: RigInstant) -> None:
        """Publish the sphere of the instant before, begin this one."""
        self.publish_last()
        self.coming.append(next(self.coming_from) if self.coming_from is not None else self.begin(instant))

    def begin(self, instant: RigInstant) -> Future[Sphere]:
        """Begin to stitch an instant."""
        values = instant.images, instant.sync.stamp_ns, instant.points, instant.depths
        stitcher = self.stitcher
        return self.pool.submit(lambda: stitcher.stitch(*values).sphere)

    def publish_last(self) -> None:
        """Wait for what has begun, and publish it."""
        if self.coming:
            self.publish(self.coming.popleft().result())


class Scout(StitcherAhead):
    """Begins instants far ahead, in other processes once nothing more is learned of the rig."""

    executor: Executor | None = None
    recipe: bytes = b""

    def stitch(self, instant: RigInstant) -> None:
        """Begin an instant."""
        self.coming.append(self.begin(instant))

    def begin(self, instant: RigInstant) -> Future[Sphere]:
        """Begin to stitch an instant where that may be done."""
        if not self.stitcher.is_settled:
            wait(list(self.coming))  # what it learns from those before decides
        if self.executor is None or not self.stitcher.is_settled:
            return super().begin(instant)
        self.recipe = self.recipe or recipe_of(self.stitcher)
        values = instant.images, instant.sync.stamp_ns, instant.points, instant.depths
        return self.executor.submit(stitch_task, StitchTask(self.recipe, *values))


def stitch_apart(
    path: Path, values: dict[str, Any], remap: dict[str, str], executor: Executor, num_ahead: int
) -> Iterator[Future[Sphere]]:
    """Yield the spheres of a bag's instants, `num_ahead` of them begun, as a second replay finds them."""
    bus = OfflineBus(captured=set())
    scout = bus.add(Scout, values, remap)
    assert isinstance(scout, Scout)
    scout.executor = executor
    try:
        with BagReader(path) as bag:
            for _ in replay(bag, bus):
                while len(scout.coming) > num_ahead:
                    yield scout.coming.popleft()
        scout.finish_open()
        yield from scout.coming
    finally:
        scout.cleanup()
