"""The state machine of FIELD 6.4: when a pose may be trusted. Motion is allowed in TRACKING, slowly in DEGRADED."""

from __future__ import annotations

from sphere_nav.localization.constants import FORGIVE_NS, MAX_PROBATION_FACTOR, RECOVERY_IMAGES
from sphere_nav.localization.params import StateParams
from sphere_nav.localization.status import FOLLOWING, TRUSTED, State


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

    def start(self) -> None:
        """Put a pose that was found on probation."""
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
