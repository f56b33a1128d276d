"""Stitching beside mapping, for recordings."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_mapping.acquisition.ros.rig_intake import RigInstant
from sphere_mapping.acquisition.stitching import stages
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.spheres.sphere import Sphere


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
        self.recipe = self.recipe or stages.recipe_of(self.stitcher)
        values = instant.images, instant.sync.stamp_ns, instant.points, instant.depths
        return self.executor.submit(stages.stitch, stages.StitchTask(self.recipe, *values))


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
