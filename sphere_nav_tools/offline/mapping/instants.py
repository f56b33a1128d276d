"""What a bag shows, instant by instant: spheres, or the rectified images of its pair before they are matched."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from std_msgs.msg import Header

from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import Intake
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformListener

_HEARD = "/collector/heard"  # each instant, so that a replay can end after it


class Collector(ManagedNode):
    """Keeps what a bag gives of each instant: a sphere, and what belongs to it."""

    NAME = "collector"
    PARAMS = SphereMapperParams
    params: SphereMapperParams
    wants_pairs: ClassVar[bool] = False

    def configure(self) -> None:
        """Listen."""
        self.heard, self.publisher = deque[Any](), self.add_publisher(_HEARD, Header)
        lookup, on_pair = TransformListener(self.endpoints).lookup, None
        if self.wants_pairs:
            on_pair = self._keep
        Intake(self.params, self._keep, lookup, on_pair=on_pair).subscribe(self.endpoints)

    def _keep(self, *instant: Any) -> None:
        self.heard.append(instant)
        self.publisher.publish(Header())


class PairCollector(Collector):
    """Keeps left and right image, rectified, and their pair."""

    wants_pairs = True


def collect(
    bag: BagReader, values: Mapping[str, Any], remap: dict[str, str], kind: type[Collector] = Collector
) -> tuple[Collector, Iterator[Any]]:
    """Return a collector, and what it keeps of each instant, as the bag goes on."""
    bus = OfflineBus(captured={_HEARD})
    node = bus.add(kind, values, remap)
    return node, (node.heard.popleft() for _ in replay(bag, bus))
