"""What the follower is doing: the states of FollowerStatus and the only ways between them."""

from __future__ import annotations

import enum

from path_follower.reasons import FINE, StopReason, StopVerdict


class FollowerState(enum.StrEnum):
    """The words of FollowerStatus."""

    NO_PATH = "NO_PATH"
    IDLE = "IDLE"
    DRIVING = "DRIVING"
    SLOW = "SLOW"
    PAUSED = "PAUSED"
    STOPPING = "STOPPING"
    STOPPED = "STOPPED"
    FINISHED = "FINISHED"


SLOWLY = StopVerdict(StopReason.LOCALISATION_DEGRADED, advice="driving slowly until the localiser is TRACKING again")
ARMED = (FollowerState.DRIVING, FollowerState.SLOW, FollowerState.PAUSED)


class Mode:
    """State and the verdict that led to it. Every stop disarms: after it only `arm` or `go_on` drives."""

    def __init__(self) -> None:
        """Begin without a path."""
        self.state = FollowerState.NO_PATH
        self.verdict = FINE

    @property
    def is_armed(self) -> bool:
        """Whether motion is allowed, now or by `resume`."""
        return self.state in ARMED

    @property
    def is_driving(self) -> bool:
        """Whether the vehicle follows the path."""
        return self.state in (FollowerState.DRIVING, FollowerState.SLOW)

    @property
    def is_at_rest(self) -> bool:
        """Whether neither a drive nor a stop is going on."""
        return self.state in (FollowerState.NO_PATH, FollowerState.IDLE, FollowerState.STOPPED, FollowerState.FINISHED)

    @property
    def has_ended(self) -> bool:
        """Whether the next start begins anew, not at the place reached."""
        return self.state in (FollowerState.IDLE, FollowerState.FINISHED)

    @property
    def is_stopping_hard(self) -> bool:
        """Whether the deceleration of a stop for safety is wanted."""
        return not self.is_armed and not self.verdict.is_gentle

    def load(self) -> None:
        """A path was loaded."""
        self.state, self.verdict = FollowerState.IDLE, FINE

    def arm(self) -> None:
        """Drive from standstill."""
        self.state, self.verdict = FollowerState.DRIVING, FINE

    def go_on(self) -> None:
        """Drive on, because what was missing has come back before standstill."""
        if self.state is FollowerState.STOPPING:
            self.state, self.verdict = FollowerState.DRIVING, FINE

    def stand(self, verdict: StopVerdict) -> None:
        """Be at standstill and disarmed at once: what the vehicle did meanwhile is not known."""
        if not self.is_at_rest:
            self.state, self.verdict = FollowerState.STOPPED, verdict

    def pause(self) -> None:
        """Stand, armed."""
        if self.is_driving:
            self.state, self.verdict = FollowerState.PAUSED, StopVerdict(StopReason.OPERATOR)

    def halt(self, verdict: StopVerdict) -> None:
        """Stop and disarm, unless all is fine; the first reason stays, unless a hard stop follows a gentle one."""
        if verdict is FINE:
            return
        if self.is_armed or (self.state is FollowerState.STOPPING and self.verdict.is_gentle and not verdict.is_gentle):
            self.state, self.verdict = FollowerState.STOPPING, verdict

    def finish(self) -> None:
        """The end of the path is reached, standing."""
        if self.is_driving:
            self.state, self.verdict = FollowerState.FINISHED, StopVerdict(StopReason.END_OF_PATH)

    def settle(self, *, is_standing: bool, is_slow: bool, doubt: StopVerdict = FINE) -> None:
        """Follow what the vehicle does: a stop that stands is STOPPED; SLOW and DRIVING go by the localisation.

        `doubt`: why it is slow, where it is not for a DEGRADED localiser.
        """
        if self.state is FollowerState.STOPPING and is_standing:
            self.state = FollowerState.STOPPED
        elif self.is_driving:
            self.state = FollowerState.SLOW if is_slow else FollowerState.DRIVING
            self.verdict = FINE if not is_slow else SLOWLY if doubt is FINE else doubt
