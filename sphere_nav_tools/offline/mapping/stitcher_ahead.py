"""Stitching beside mapping, for recordings, in this process or in others.

A stitcher learns its lenses' falloff from its first instants and checks its rig once; from then on an instant depends
on nothing that was before, and is stitched wherever there is time.
"""

from __future__ import annotations

import pickle
from collections import deque
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any

from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_mapping.acquisition.ros.rig_intake import RigInstant
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.constants import AHEAD

Node = tuple[dict[str, Any], dict[str, str]]  # values of parameters by dotted name, topics of the bag by ours


def stitch_apart(known: bytes, images: Any, stamp_ns: int, points: Any, depths: Any) -> Sphere:
    """Return the sphere of an instant by what was learned of its rig, in whatever process."""
    return _stitcher(known).stitch(images, stamp_ns, points, depths)


@lru_cache(maxsize=1)
def _stitcher(known: bytes) -> Stitcher:
    """Return a stitcher that gives the same bits as the one that has learned."""
    rig, params, masks, learned = pickle.loads(known)
    stitcher = Stitcher(rig, params, masks, 1)
    stitcher.resume(learned)
    return stitcher


class StitcherAhead(SphereStitcher):
    """The stitcher, some instants ahead of the mapper: a sphere is published when a later instant is complete.

    So both work side by side, and the order of all messages is the same on every machine and for every `executor`.
    """

    executor: Executor | None = None  # of other processes, else a thread of this one

    def configure(self) -> None:
        """Open the thread that stitches."""
        self.pool, self.coming, self._known = ThreadPoolExecutor(1), deque[Future[Sphere]](), b""
        super().configure()

    def cleanup(self) -> None:
        """Close the thread; what it has not begun is not stitched any more."""
        self.pool.shutdown(cancel_futures=True)
        super().cleanup()

    def stitch(self, instant: RigInstant) -> None:
        """Publish the sphere of an earlier instant, begin this one."""
        if len(self.coming) == AHEAD:
            self.publish_next()
        self.coming.append(self.begin(instant))

    def begin(self, instant: RigInstant) -> Future[Sphere]:
        """Begin to stitch an instant; here while the stitcher learns."""
        values = instant.images, instant.sync.stamp_ns, instant.points, instant.depths
        stitcher = self.stitcher
        if self.executor is None or not stitcher.is_settled:
            return self.pool.submit(lambda: stitcher.stitch(*values))
        self._known = self._known or pickle.dumps((stitcher.rig, stitcher.params, stitcher.masks, stitcher.learned))
        return self.executor.submit(stitch_apart, self._known, *values)

    def publish_next(self) -> None:
        """Wait for the oldest instant that has begun, and publish its sphere."""
        self.publish(self.coming.popleft().result())
