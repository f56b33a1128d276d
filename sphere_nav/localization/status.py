"""What a localiser says about itself: the one vocabulary of both localisers, word by word LocalizationStatus.msg.

A `Status` is the news of one image: a state, and where it is not the best one a reason with its evidence. What to do
about a fault of the input is the same for both (`INPUT_REMEDIES`); for the other reasons each localiser has its own
advice: the same word asks for other remedies in a map of images and in bare geometry.

The `StateMachine` of FIELD 6.4 says when a pose may be trusted. Motion is allowed in TRACKING, slowly in DEGRADED.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.constants import FORGIVE_NS, MAX_PROBATION_FACTOR, RECOVERY_IMAGES
from sphere_nav.localization.params import StateParams

__all__ = [
    "FINE",
    "FOLLOWING",
    "INPUT_REMEDIES",
    "TRUSTED",
    "BaseEstimate",
    "Reason",
    "State",
    "StateMachine",
    "Status",
    "Verdict",
    "describe_status",
    "status_of",
]  # fmt: skip


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


INPUT_REMEDIES = {
    Reason.NONE: "",
    Reason.GAP: "images are missing: check the camera's rate, its QoS and the load of the computer",
    Reason.TIMEOUT: "no image arrives: check that the camera runs, the topic name and its QoS",
    Reason.FROZEN: "the camera repeats one image: restart its driver (a noise-free simulator: input.allow_still)",
    Reason.BAD_STAMP: "stamps must be set, grow, and be of this computer's time: check the camera driver's clock",
    Reason.BAD_INFO: "camera_info does not fit the image: calibrate, or publish the info of this resolution",
    Reason.TF_STALE: "publish the transform from the base to the camera on /tf_static, or set mounting",
    Reason.LOW_TEXTURE: "too little to see: check exposure, lens and light",
    Reason.OVERRUN: "images come faster than they are answered: lower the camera's rate",
}


@dataclass(frozen=True)
class Verdict:
    """One fact against an image or a drive: a reason of some vocabulary, a number and its limit, in the same unit.

    `detail` says what the number is, or what was found; `advice` takes the place of the usual remedy.
    """

    reason: StrEnum
    value: float = 0.0
    limit: float = 0.0
    detail: str = ""
    advice: str = ""

    def advise(self, remedies: Mapping[Any, str]) -> str:
        """Return what to do, in one line."""
        return self.advice or remedies[self.reason]

    def remedy(self, remedies: Mapping[Any, str]) -> str:
        """Return one line on what to do, led by the detail."""
        advice = self.advise(remedies)
        return f"{self.detail}; {advice}" if self.detail else advice


FINE = Verdict(Reason.NONE)


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
    p_chance: float = 1.0  # probability that chance would look like this place; 1 where it was not tested
    map_id: str = ""  # of the map in use; empty: unknown


def status_of(
    state: State,
    stamp_ns: int,
    finding: Verdict,
    remedies: Mapping[Any, str] = INPUT_REMEDIES,
    *,
    quality: float = 0.0,
    p_chance: float = 1.0,
    age: float = 0.0,
) -> Status:
    """Return the status of a state with its finding, put into words by `remedies`."""
    words = str(finding.reason), finding.value, finding.limit, finding.remedy(remedies)
    return Status(state, *words, quality=quality, p_chance=p_chance, age=max(age, 0.0), stamp_ns=stamp_ns)


def describe_status(status: Status) -> str:
    """Return a status in one line."""
    if not status.reason:
        return f"{status.state}: {status.remedy}" if status.remedy else str(status.state)
    return f"{status.state}: {status.reason} ({status.value:.3g}, limit {status.limit:.3g}): {status.remedy}"


@dataclass(frozen=True)
class BaseEstimate:
    """The news of one image; without trust there is no pose.

    covariance (6, 6) is that of xi = (v, omega) in T_map_base @ exp(xi); velocity (6,) is that of the base.
    odometry_covariance (6, 6) is that of the way since it was localised; None: `covariance`.
    """

    status: Status
    T_map_base: SE3 | None = None
    covariance: Array | None = None
    velocity: Array | None = None
    velocity_covariance: Array | None = None
    odometry_covariance: Array | None = None


class StateMachine:
    """Counts good and bad images; knows nothing of what is in them. Times are stamps."""

    def __init__(self, params: StateParams) -> None:
        self._params = params
        self.state = State.NOT_LOCALISED
        self.num_losses = self.num_refused = 0  # refused: images in a row
        self._num_good = self._tracking_since_ns = 0

    @property
    def is_following(self) -> bool:
        """Whether a pose is carried from image to image."""
        return self.state in FOLLOWING

    @property
    def is_trusted(self) -> bool:
        """Whether the pose may be published."""
        return self.state in TRUSTED

    @property
    def after_silence(self) -> State:
        """What to say of the pose when no image comes any more; the state itself waits for the next image."""
        return State.LOST if self.is_following else self.state

    @property
    def probation_images(self) -> int:
        """Good images in a row that end the probation; doubled by each loss up to a bound."""
        return int(self._params.probation_images * min(2 ** min(self.num_losses, 16), MAX_PROBATION_FACTOR))

    def reset(self) -> None:
        """Begin anew: nothing is known of the pose, earlier losses are forgotten."""
        self.num_losses = 0
        self._enter(State.NOT_LOCALISED)

    def search(self) -> None:
        """Say that the whole map is being searched."""
        self._enter(State.SEARCHING)

    def withdraw(self) -> None:
        """Say that nobody searches: the pose must be given."""
        self._enter(State.NOT_LOCALISED)

    def start(self, *, is_found_again: bool = False) -> None:
        """Put a pose that was found on probation; one that was lost, and `is_found_again`, was no wrong one."""
        self.num_losses = max(0, self.num_losses - is_found_again)
        self._enter(State.PROBATION)

    def lose(self) -> None:
        """Give the pose up."""
        self.num_losses += 1
        self._enter(State.LOST)

    def confirm(self, stamp_ns: int, *, is_good: bool, num_images: int = 1) -> None:
        """Count an image that confirms the pose; `is_good` is false when it does so with care.

        Of a pose on probation that several images prove together, it may count for more than one.
        """
        self._num_good, self.num_refused = (self._num_good + num_images if is_good else 0), 0
        if self.state is State.PROBATION and self._num_good >= self.probation_images:
            self._enter(State.TRACKING)
        elif self.state is State.TRACKING:
            self._forgive(stamp_ns)
            if not is_good:
                self._enter(State.DEGRADED)
        elif self.state is State.DEGRADED and self._num_good >= RECOVERY_IMAGES:
            self._enter(State.TRACKING)

    def refuse(self, *, is_lost: bool) -> None:
        """Count an image that does not confirm the pose; on probation, or where `is_lost`, the pose is given up."""
        num_refused = self.num_refused + 1
        if self.state is State.PROBATION or (self.is_following and is_lost):
            self.lose()
        elif self.state is State.TRACKING:
            self._enter(State.DEGRADED)
        self._num_good, self.num_refused = 0, num_refused

    def _forgive(self, stamp_ns: int) -> None:
        """Forget one loss after each long stretch of tracking."""
        self._tracking_since_ns = self._tracking_since_ns or stamp_ns
        if stamp_ns - self._tracking_since_ns > FORGIVE_NS:
            self._tracking_since_ns, self.num_losses = stamp_ns, max(0, self.num_losses - 1)

    def _enter(self, state: State) -> None:
        self.state = state
        self._num_good = self.num_refused = 0
        self._tracking_since_ns = 0
