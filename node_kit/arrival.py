"""Stamps against the clock of the node: what is stamped with the future is not believed.

A stamp decides what a message is compared with. One that is ahead of the clock would make all that follow look late.
"""

from __future__ import annotations

MAX_AHEAD_NS = 100_000_000  # /clock may come later than what it stamps; more is a wrong clock


def ahead_s(stamp_ns: int, now_ns: int) -> float:
    """Return by how many seconds a stamp is too far ahead of the clock; 0 where it is not, or there is no time yet."""
    lead_ns = stamp_ns - now_ns
    return lead_ns * 1e-9 if now_ns > 0 and lead_ns > MAX_AHEAD_NS else 0.0


def check_stamp(stamp_ns: int, now_ns: int, name: str) -> None:
    """Raise ValueError for a stamp that is too far ahead of the clock."""
    found = ahead_s(stamp_ns, now_ns)
    if found:
        raise ValueError(f"{name}: stamp: expected at most {MAX_AHEAD_NS * 1e-9:g} s ahead, found {found:.3f} s")
