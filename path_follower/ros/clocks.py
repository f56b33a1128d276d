"""Time that no stamp can move: stamps on the follower's own clock."""

from __future__ import annotations

from collections.abc import Callable

from sphere_nav.ros.clocks import MAX_AHEAD_NS


class Times:
    """Stamps on the follower's own clock."""

    def __init__(self, clock: Callable[[], int], own: Callable[[], int]) -> None:
        """`clock` is that of the stamps, `own` one that no stamp moves, both in ns."""
        self._clock, self._own = clock, own

    def now(self) -> int:
        """Return the present."""
        return self._own()

    def lead(self, stamp_ns: int) -> int:
        """Return by how many ns a stamp is ahead of its clock; negative: the age of what it stamps."""
        return stamp_ns - self._clock()

    def of(self, stamp_ns: int) -> int:
        """Return the time from which a message counts, never later than now; ValueError for a stamp too far ahead."""
        lead = self.lead(stamp_ns)
        if lead > MAX_AHEAD_NS:
            limit, found = MAX_AHEAD_NS / 1e9, lead / 1e9
            raise ValueError(f"header.stamp: expected at most {limit:g} s ahead of the clock, found {found:.3f} s")
        return self._own() + min(lead, 0)
