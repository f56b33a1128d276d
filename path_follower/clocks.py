"""Time that no stamp can move: stamps on the follower's own clock, and a clock that stands still."""

from __future__ import annotations

from collections.abc import Callable

MAX_LEAD_NS = 100_000_000  # that a stamp may be ahead of the clock; more is a wrong clock
MAX_STANDSTILL = 0.4  # s of steady time without an advance of the node's clock: the ramp to zero begins
MAX_LOOK = 0.1  # s between two looks that count: in a longer gap this process stood, not the clock


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
        if lead > MAX_LEAD_NS:
            limit, found = MAX_LEAD_NS / 1e9, lead / 1e9
            raise ValueError(f"header.stamp: expected at most {limit:g} s ahead of the clock, found {found:.3f} s")
        return self._own() + min(lead, 0)


class ClockWatch:
    """Compares the node's clock, which may be simulated, with steady time.

    Where a simulator's clock stands, so does its vehicle, however slow the machine: that is a pause. What a clock that
    goes on later has left out is silence like any other, and judged as such.
    """

    def __init__(self, give_up: float) -> None:
        """`give_up`: s of standstill after which it is no pause any more."""
        self._give_up = give_up
        self._clock_ns, self._seen_ns = 0, 0
        self.stood = 0.0  # s of steady time since the clock advanced

    def observe(self, clock_ns: int, steady_ns: int) -> None:
        """Look at both clocks."""
        passed = min((steady_ns - self._seen_ns) / 1e9, MAX_LOOK)
        self.stood = self.stood + passed if clock_ns == self._clock_ns != 0 else 0.0
        self._clock_ns, self._seen_ns = clock_ns, steady_ns

    @property
    def is_standing(self) -> bool:
        """Whether time has stopped."""
        return self.stood > MAX_STANDSTILL

    @property
    def is_over(self) -> bool:
        """Whether what stood so long ends the drive."""
        return self.stood > max(self._give_up, MAX_STANDSTILL)
