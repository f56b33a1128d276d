"""What a localiser says about itself: the one vocabulary of both localisers, word by word LocalizationStatus.msg.

A `Status` is the news of one image: a state, and where it is not the best one a reason with its evidence. Each
localiser gives the reasons its own advice: the same word asks for other remedies in a map of images and in bare
geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

__all__ = ["FOLLOWING", "TRUSTED", "Finding", "Reason", "State", "Status"]


class State(StrEnum):
    """States in the order in which a start passes through them."""

    UNCONFIGURED = "UNCONFIGURED"
    NO_MAP = "NO_MAP"
    NOT_LOCALISED = "NOT_LOCALISED"
    SEARCHING = "SEARCHING"
    PROBATION = "PROBATION"
    TRACKING = "TRACKING"
    DEGRADED = "DEGRADED"
    LOST = "LOST"


TRUSTED = (State.TRACKING, State.DEGRADED)  # the pose may leave the localiser
FOLLOWING = (State.PROBATION, *TRUSTED)  # a pose is carried from image to image


class Reason(StrEnum):
    """Why the state is not better; the empty word: nothing is wrong."""

    NONE = ""
    GAP = "GAP"
    TIMEOUT = "TIMEOUT"
    FROZEN = "FROZEN"
    BAD_STAMP = "BAD_STAMP"
    BAD_INFO = "BAD_INFO"
    TF_STALE = "TF_STALE"
    LOW_OVERLAP = "LOW_OVERLAP"
    LOW_TEXTURE = "LOW_TEXTURE"
    LIGHT_CHANGE = "LIGHT_CHANGE"
    OUTLIERS = "OUTLIERS"
    NO_CONVERGENCE = "NO_CONVERGENCE"
    JUMP_REJECTED = "JUMP_REJECTED"
    AMBIGUOUS = "AMBIGUOUS"
    OUTSIDE_REGION = "OUTSIDE_REGION"
    MAP_ERROR = "MAP_ERROR"
    ODOM_STALE = "ODOM_STALE"
    OVERRUN = "OVERRUN"


@dataclass(frozen=True)
class Finding:
    """One fact against an image: a reason, a number and its limit; `detail` names what the number is where needed.

    A localiser derives its own class with `ADVICE`: what to do about each reason that it gives.
    """

    reason: Reason
    value: float = 0.0
    limit: float = 0.0
    detail: str = ""
    ADVICE: ClassVar[Mapping[Reason, str]] = {Reason.NONE: ""}

    @property
    def remedy(self) -> str:
        """One line on what to do, led by the detail."""
        advice = self.ADVICE[self.reason]
        return f"{self.detail}; {advice}" if self.detail else advice


@dataclass(frozen=True)
class Status:
    """The news of one image, field by field what LocalizationStatus.msg carries; zero where nothing was measured."""

    state: State
    reason: str = ""
    value: float = 0.0
    limit: float = 0.0
    remedy: str = ""
    quality: float = 0.0  # 0 useless to 1 perfect
    references: tuple[int, ...] = ()  # ids of the key spheres
    overlap: float = 0.0  # share of the chosen pixels that the image sees
    inlier_share: float = 0.0
    mad: float = 0.0  # grey levels
    iterations: int = 0
    milliseconds: float = 0.0  # filled by whoever holds the watch
    age: float = 0.0  # seconds since the last image that confirmed the pose; 0 before the first
    stamp_ns: int = 0
