"""Stitching beside mapping, for recordings."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor

from sphere_mapping.acquisition.stitcher import Stitched
from sphere_mapping.rig_intake_node import RigInstant
from sphere_mapping.stitcher_node import SphereStitcher


class StitcherAhead(SphereStitcher):
    """The stitcher, one instant ahead of the mapper: a sphere is published when the next instant is complete.

    So both work side by side, and the order of all messages is the same on every machine.
    """

    def configure(self) -> None:
        """Open the thread that stitches."""
        self.pool, self.coming = ThreadPoolExecutor(1), deque[Future[Stitched]]()
        super().configure()

    def cleanup(self) -> None:
        """Close the thread; what it has not begun is not stitched any more."""
        self.pool.shutdown(cancel_futures=True)
        super().cleanup()

    def stitch(self, instant: RigInstant) -> None:
        """Publish the sphere of the instant before, begin this one."""
        self.publish_last()
        values = instant.images, instant.sync.stamp_ns, instant.points, instant.depths
        self.coming.append(self.pool.submit(self.stitcher.stitch, *values))

    def publish_last(self) -> None:
        """Wait for what has begun, and publish it."""
        if self.coming:
            self.publish(self.coming.popleft().result().sphere)
