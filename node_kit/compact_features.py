"""Features of key spheres that wait on the disk: a search reads those of a few of them."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping

import numpy as np

from node_kit.spool import Spool
from sphere_map.appearance.features import SIZE, Features

LAYOUT = np.dtype([("ray", "<f4", 3), ("range", "<f4"), ("descriptor", "u1", SIZE)])


class CompactFeatures(MutableMapping[int, Features]):
    """Features by id of their key sphere."""

    def __init__(self) -> None:
        self._places: dict[int, int] = {}
        self._spool = Spool()

    def __getitem__(self, sphere_id: int) -> Features:
        table = np.frombuffer(self._spool[self._places[sphere_id]], LAYOUT)
        return Features(*(np.ascontiguousarray(table[name]) for name in ("ray", "range", "descriptor")))

    def __setitem__(self, sphere_id: int, features: Features) -> None:
        table = np.empty(len(features), LAYOUT)
        table["ray"], table["range"], table["descriptor"] = features.rays, features.range_m, features.descriptors
        self._places[sphere_id] = self._spool.add(table.tobytes())

    def __delitem__(self, sphere_id: int) -> None:
        del self._places[sphere_id]

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)
