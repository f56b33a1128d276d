"""Whether a stop ends by itself: the rule `safety.resume`."""

from __future__ import annotations

from path_follower.modes import Mode, State

STEADY_NS = 2_000_000_000  # of TRACKING without a pause, after which a standing vehicle may go on


class Resumption:
    """Only what was missing may end a stop by its return; what was wrong waits for the call `start`."""

    def __init__(self, rule: str) -> None:
        """`rule`: never, moving (before standstill) or standing (also after it)."""
        self._rule = rule
        self._steady_ns: int | None = None

    def is_due(self, mode: Mode, now_ns: int, *, is_fine: bool, is_tracking: bool) -> bool:
        """Return whether to go on; `is_fine`: nothing speaks against motion, `is_tracking`: localised without doubt."""
        may_pass = is_fine and mode.verdict.may_pass and self._rule != "never"
        if may_pass and mode.state is State.STOPPING:
            return True
        if not (may_pass and is_tracking and mode.state is State.STOPPED and self._rule == "standing"):
            self._steady_ns = None
            return False
        if self._steady_ns is None:
            self._steady_ns = now_ns
        return now_ns - self._steady_ns >= STEADY_NS
