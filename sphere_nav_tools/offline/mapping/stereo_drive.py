"""What a drive says about its stereo pair, before it is mapped: rows, and what is off in the disparity."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header
from tqdm import tqdm

from sphere_mapping.acquisition.constants import NUM_VIEWS
from sphere_mapping.acquisition.stereo.corner_tracks import follow_window
from sphere_mapping.acquisition.stereo.stereo_field import StereoField
from sphere_mapping.acquisition.stereo.stereo_pair import StereoPair
from sphere_mapping.acquisition.stereo.track_fit import ColumnFit, Window, fit_columns
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import Intake
from sphere_mapping.ros.stereo_intake import describe_rows
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.sphere import to_gray_bytes
from sphere_nav_tools.offline.constants import MAX_PAIRS, MAX_WINDOWS

FOLLOWED = "/pair_follower/followed"  # each pair, so that a replay can end after the last one
TERMS = ("", " x^2", " x", " y", " x y", " y^2", " x^3", " x^4")


class PairFollower(ManagedNode):
    """Follows corners through the pairs of a bag."""

    NAME = "pair_follower"
    PARAMS = SphereMapperParams
    params: SphereMapperParams

    def configure(self) -> None:
        """Listen."""
        self.pair: StereoPair | None = None
        self.windows: list[Window] = []
        self.num_pairs, self.step, self._open = 0, NUM_VIEWS, list[tuple[NDArray, NDArray]]()
        lookup = TransformListener(self.endpoints, is_required=False).lookup
        self.followed = self.add_publisher(FOLLOWED, Header)
        Intake(self.params, lambda *_: None, lookup, on_pair=self._on_pair).subscribe(self.endpoints)

    def _on_pair(self, left: NDArray, right: NDArray, pair: StereoPair) -> None:
        self.pair, place = pair, self.num_pairs % self.step
        self.num_pairs += 1
        self.followed.publish(Header())
        if place < NUM_VIEWS:
            self._open.append((to_gray_bytes(left), to_gray_bytes(right)))
        if len(self._open) == NUM_VIEWS:
            g = pair.geometry
            window = follow_window(g.camera, g.baseline_m, *zip(*self._open, strict=True))
            self.windows += [window] if window is not None else []
            self._open = []


def find_field(bag: BagReader, values: dict[str, Any], remap: dict[str, str]) -> tuple[StereoPair | None, str]:
    """Return the pair of a drive with its correction, and that in words; None and nothing where nothing can be said."""
    bus = OfflineBus(captured={FOLLOWED})
    node = bus.add(PairFollower, values, remap)
    assert isinstance(node, PairFollower)
    number = min(bag.topics[remap["left/image_raw"]].count, MAX_PAIRS)
    node.step = max(number // MAX_WINDOWS, NUM_VIEWS - 1)
    with tqdm(total=number, desc="stereo", unit="pair", leave=False, disable=None) as bar:
        for _ in replay(bag, bus):
            bar.update(node.num_pairs - bar.n)
            if node.num_pairs >= number:
                break
    if node.pair is None:
        return None, ""
    geometry, rows = node.pair.geometry, node.pair.fit
    _, words = describe_rows(node.pair, node.params.mapper.stereo.calibration_px)
    found = fit_columns(geometry.camera, geometry.baseline_m, node.windows)
    is_bent = found is not None and found.is_significant
    correction = StereoField(
        tuple(rows.rows) if rows is not None and rows.is_significant else StereoField().rows,
        tuple(found.columns) if found is not None and is_bent else StereoField().columns,
    )
    pair = StereoPair(geometry, correction, rows)
    return pair, f"stereo: {words}; {describe_disparity(found) if is_bent and found else 'disparity as told'}"


def describe_disparity(found: ColumnFit) -> str:
    """Return what is off in the disparity in words."""
    terms = " ".join(f"{value:+.2f}{name}" for value, name in zip(found.columns, TERMS, strict=False))
    deviations = ", ".join(f"{value:.2f}" for value in np.sqrt(np.diag(found.covariance)))
    return (
        f"disparity too small by {terms.removeprefix('+')} px (x, y: tangents; deviations {deviations}, "
        f"from {found.num_tracks} corners), corrected"
    )
