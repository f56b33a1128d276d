"""Stamps and clocks: stamps ahead of the clock, time that no stamp can move, and a clock that stands still.

A stamp decides what a message is compared with. One that is ahead of the clock would make all that follow look late.
Where time is simulated, what a node does by itself depends on that time alone, never on how fast the machine is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from sphere_nav.ros.constants import (
    CLOCK_PATIENCE_S,
    FORGET,
    MAX_AHEAD_NS,
    MAX_CAUGHT_UP_NS,
    MAX_LOOK_S,
    MAX_PATIENCE_S,
)
from sphere_nav.ros.endpoints import Endpoints


def ahead_s(stamp_ns: int, now_ns: int) -> float:
    """Return by how many seconds a stamp is too far ahead of the clock; 0 where it is not, or there is no time yet."""
    lead_ns = stamp_ns - now_ns
    return lead_ns * 1e-9 if now_ns > 0 and lead_ns > MAX_AHEAD_NS else 0.0


def check_stamp(stamp_ns: int, now_ns: int, name: str) -> None:
    """Raise ValueError for a stamp that is too far ahead of the clock."""
    found = ahead_s(stamp_ns, now_ns)
    if found:
        raise ValueError(
            f"{name}: stamp: expected at most {MAX_AHEAD_NS * 1e-9:g} s ahead of the clock, found {found:.3f} s"
        )


class ClockWatch:
    """Compares the node's clock, which may be simulated, with steady time.

    Where a simulator's clock stands, so does its vehicle, however slow the machine: that is a pause, for as long as
    somebody publishes the clock. What a clock that goes on later has left out is silence like any other, and judged as
    such.
    """

    def __init__(self, give_up: float, patience: float = CLOCK_PATIENCE_S, max_look: float = MAX_LOOK_S) -> None:
        """`patience`: s of standstill until it counts as a pause; `give_up`: s without a publisher until it is none.

        On a slow machine a simulator's clock advances in long steps; patience grows to twice the last ones.
        `max_look`: s between two looks that count; in a longer gap this process stood, not the clock.
        """
        self._give_up, self._least, self._patience, self._max_look = give_up, patience, patience, max_look
        self._clock_ns, self._seen_ns = 0, 0
        self.stood = 0.0  # s of steady time since the clock advanced
        self.abandoned = 0.0  # s of these without a publisher

    def observe(self, clock_ns: int, steady_ns: int, has_publisher: Callable[[], bool] = lambda: False) -> None:
        """Look at both clocks; `has_publisher`, asked while the first one stands: could somebody let it go on."""
        passed = min((steady_ns - self._seen_ns) / 1e9, self._max_look)
        stands = clock_ns == self._clock_ns != 0
        slow = 0.0 if stands else min(2.0 * self.stood, MAX_PATIENCE_S)
        self._patience = max(self._least, slow, self._patience - FORGET * passed)
        self.stood = self.stood + passed if stands else 0.0
        is_held = self.is_standing and has_publisher()
        self.abandoned = self.abandoned + passed if stands and not is_held else 0.0
        self._clock_ns, self._seen_ns = clock_ns, steady_ns

    @property
    def is_standing(self) -> bool:
        """Whether time has stopped."""
        return self.stood > self._patience

    @property
    def pause(self) -> float:
        """Seconds since it counts as a pause."""
        return max(0.0, self.stood - self._patience)

    @property
    def is_over(self) -> bool:
        """Whether what stood so long without a publisher is no pause any more."""
        return self.abandoned > max(self._give_up, self._patience)


class SimulatedTicks:
    """When a node of simulated time acts by itself: every `period` s from `silence` s after the last message on.

    The times are those of the simulation, not of the wall, and none is left out: what is due before a message is done
    before it, however late this process is served. So the same drive takes the same steps on every machine.
    """

    def __init__(self, silence: float, period: float) -> None:
        """Begin when time is first heard."""
        self._silence_ns, self._period_ns = round(silence * 1e9), round(period * 1e9)
        self._due_ns = 0

    def restart(self, now_ns: int) -> None:
        """Count silence from a message of this time on; 0: from when time is heard next."""
        self._due_ns = now_ns and now_ns + self._silence_ns

    def take(self, now_ns: int) -> Iterator[int]:
        """Yield the times that are due before now; the present itself belongs to messages that may still come."""
        self._due_ns = max(self._due_ns or now_ns, now_ns - MAX_CAUGHT_UP_NS)
        while 0 < self._due_ns < now_ns:
            due_ns, self._due_ns = self._due_ns, self._due_ns + self._period_ns
            yield due_ns


def time_of(stamp_ns: int, endpoints: Endpoints) -> int:
    """Return the own time from which a message counts, never later than now; ValueError for a stamp too far ahead."""
    now_ns = endpoints.now_ns()
    check_stamp(stamp_ns, now_ns, "header")
    return endpoints.own_ns() + min(stamp_ns - now_ns, 0)
