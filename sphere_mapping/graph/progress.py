"""What the mapper says of every sphere, and what it keeps of those that are no key spheres."""

from __future__ import annotations

from dataclasses import dataclass

from photometric import Alignment
from sphere_geometry import SE3
from sphere_mapping.graph import keyframes


@dataclass(frozen=True, eq=False)
class MapUpdate:
    """What one sphere changed. T_map_sphere is None where the sphere could not be placed; `alignment` says why."""

    stamp_ns: int
    T_map_sphere: SE3 | None
    alignment: Alignment | None = None
    key_reason: str = keyframes.NOT_YET

    @property
    def is_key(self) -> bool:
        """Whether the sphere became a key sphere."""
        return self.key_reason != keyframes.NOT_YET


@dataclass(frozen=True, eq=False)
class Track:
    """A placed sphere by its reference, so that its pose follows when the graph is corrected."""

    stamp_ns: int
    key_id: int
    T_key_sphere: SE3
