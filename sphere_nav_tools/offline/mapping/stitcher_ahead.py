"""Stitching beside mapping, for recordings, of the instants of a segment, with what the drive's beginning has told.

A stitcher learns its lenses' falloff from its first instants and checks its rig once; from then on an instant depends
on nothing that was before. So that of a segment begins with what was learned where the drive begins.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray
from std_msgs.msg import Header

from sphere_mapping.acquisition.light.light import Learned
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_mapping.acquisition.ros.rig_intake import RigInstant
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import Rig
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.mapping.segments import DriveSegment

Node = tuple[dict[str, Any], dict[str, str]]  # values of parameters by dotted name, topics of the bag by ours
STITCHED = "/rig_learner/stitched"  # each instant, so that a replay can end


@dataclass(frozen=True, eq=False)
class LearnedRig:
    """A rig, corrected by its images where that was asked for, and what a stitcher has learned of it."""

    rig: Rig
    params: StitchParams
    masks: dict[str, NDArray[Any]] | None
    learned: Learned | None

    @classmethod
    def of(cls, stitcher: Stitcher) -> LearnedRig:
        """Return what a stitcher has learned; ValueError where it still learns."""
        if not stitcher.is_settled:
            raise ValueError(f"rig {stitcher.rig.name}: expected a stitcher that has learned it, found one that learns")
        return cls(stitcher.rig, stitcher.params, stitcher.masks, stitcher.learned)

    def stitcher(self, jobs: int = 1) -> Stitcher:
        """Return a stitcher that gives the same bits as the one that has learned."""
        stitcher = Stitcher(self.rig, self.params, self.masks, jobs)
        stitcher.resume(self.learned)
        return stitcher


class StitcherAhead(SphereStitcher):
    """The stitcher, one instant ahead of the mapper: a sphere is published when the next instant is complete.

    So both work side by side, and the order of all messages is the same on every machine.
    """

    segment = DriveSegment()

    def configure(self) -> None:
        """Open the thread that stitches."""
        self.pool, self.coming = ThreadPoolExecutor(1), deque[Future[Sphere]]()
        super().configure()

    def know(self, known: LearnedRig) -> None:
        """Go on with what was learned of the rig elsewhere."""
        self.stitcher, self.is_rectified = known.stitcher(self.params.jobs), True
        self.publish_frame()

    def cleanup(self) -> None:
        """Close the thread; what it has not begun is not stitched any more."""
        self.pool.shutdown(cancel_futures=True)
        super().cleanup()

    def stitch(self, instant: RigInstant) -> None:
        """Publish the sphere of the instant before, begin this one if it is of the segment."""
        stamp_ns = instant.sync.stamp_ns
        if stamp_ns < self.segment.warm_ns:
            return
        self.publish_last()
        if stamp_ns <= self.segment.last_ns:
            self.coming.append(self.begin(instant))

    def begin(self, instant: RigInstant) -> Future[Sphere]:
        """Begin to stitch an instant."""
        values = instant.images, instant.sync.stamp_ns, instant.points, instant.depths
        stitcher = self.stitcher
        return self.pool.submit(lambda: stitcher.stitch(*values).sphere)

    def publish_last(self) -> None:
        """Wait for what has begun, and publish it."""
        if self.coming:
            self.publish(self.coming.popleft().result())


class RigLearner(SphereStitcher):
    """Stitches until it has learned the rig."""

    NAME = "rig_learner"

    def configure(self) -> None:
        """Tell each instant."""
        self.stitched = self.add_publisher(STITCHED, Header)
        super().configure()

    def publish(self, sphere: Sphere) -> None:
        """Say that there was one; nobody wants the sphere."""
        self.stitched.publish(Header())


def learn_rig(bag: BagReader, stitcher: Node) -> LearnedRig | None:
    """Return what the beginning of a drive tells of its rig; None where all of it leaves something open."""
    bus = OfflineBus(captured={STITCHED})
    node = bus.add(RigLearner, *stitcher)
    assert isinstance(node, RigLearner)
    for _ in replay(bag, bus):
        if node.stitcher.is_settled:
            return LearnedRig.of(node.stitcher)
    return None
