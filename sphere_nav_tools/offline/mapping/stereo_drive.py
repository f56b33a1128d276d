"""What a bag shows, instant by instant, and what a drive says about its stereo pair before it is mapped.

Of the pair: the rows, and what is off in the disparity.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from typing import Any, ClassVar

import numpy as np
from std_msgs.msg import Header

from sphere_mapping.acquisition.constants import NUM_VIEWS
from sphere_mapping.acquisition.stereo.corner_tracks import follow_window
from sphere_mapping.acquisition.stereo.stereo_field import StereoField
from sphere_mapping.acquisition.stereo.stereo_pair import StereoPair
from sphere_mapping.acquisition.stereo.track_fit import Window, fit_columns
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import Intake
from sphere_mapping.ros.stereo_intake import describe_rows
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.sphere import to_gray_bytes
from sphere_nav_tools.offline.constants import MAX_PAIRS, MAX_WINDOWS
from sphere_nav_tools.offline.tables import progress

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
        lookup, on_pair = TransformListener(self.endpoints).lookup, self._keep if self.wants_pairs else None
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


def find_field(bag: BagReader, values: dict[str, Any], remap: dict[str, str]) -> tuple[StereoPair | None, str]:
    """Return the pair of a drive with its correction, and that in words; None and nothing where nothing can be said.

    Corners are followed through windows of consecutive pairs, spread over the drive.
    """
    number = min(bag.topics[remap["left/image_raw"]].count, MAX_PAIRS)
    step, windows, images, pair = max(number // MAX_WINDOWS, NUM_VIEWS - 1), list[Window](), list[Any](), None
    node, pairs = collect(bag, values, remap, PairCollector)
    for index, found in enumerate(progress("stereo", "pair", islice(pairs, number), number)):
        left, right, pair = found
        images += [(to_gray_bytes(left), to_gray_bytes(right))] * (index % step < NUM_VIEWS)
        if len(images) == NUM_VIEWS:
            window = follow_window(pair.geometry.camera, pair.geometry.baseline_m, *zip(*images, strict=True))
            windows += [window] if window is not None else []
            images = []
    if pair is None:
        return None, ""
    geometry, rows = pair.geometry, pair.fit
    _, words = describe_rows(pair, node.params.mapper.stereo.calibration_px)
    fit = fit_columns(geometry.camera, geometry.baseline_m, windows)
    correction, disparity = StereoField(), "as told"
    if rows is not None and rows.is_significant:
        correction = replace(correction, rows=tuple(rows.rows))
    if fit is not None and fit.is_significant:
        correction, off = replace(correction, columns=tuple(fit.columns)), fit.columns[0]
        told = f"{off:.2f} +- {np.sqrt(fit.covariance[0, 0]):.2f} px in the middle, by {fit.num_tracks} corners"
        disparity = f"too small by {told}, corrected"
    return StereoPair(geometry, correction, rows), f"stereo: {words}; disparity {disparity}"
