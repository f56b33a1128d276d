"""The state machine of FIELD 6.4: when a pose may be trusted. Motion is allowed in TRACKING, slowly in DEGRADED."""

from __future__ import annotations

from dataclasses import replace

from dense_localizer.params import StateParams
from dense_localizer.place import Place
from dense_localizer.reasons import Finding
from localization.status import FOLLOWING, TRUSTED, State, Status


class StateMachine:
    """Counts good and bad frames; knows nothing of images. Times are seconds between stamps."""

    def __init__(self, params: StateParams) -> None:
        self._params = params
        self.state = State.NOT_LOCALISED
        self.num_losses = 0
        self._num_good = 0
        self._tracking_s = 0.0

    @property
    def is_following(self) -> bool:
        """Whether a pose is carried from frame to frame."""
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
    def probation_frames(self) -> int:
        """Good frames in a row that end the probation; doubled by each loss up to a bound."""
        doubled = self._params.probation_frames * 2 ** min(self.num_losses, 16)
        return min(doubled, max(self._params.max_probation_frames, self._params.probation_frames))

    def reset(self) -> None:
        """Begin anew: nothing is known of the pose, earlier losses are forgotten."""
        self._enter(State.NOT_LOCALISED)
        self.num_losses = 0

    def search(self) -> None:
        """Say that the whole map is being searched."""
        self._enter(State.SEARCHING)

    def withdraw(self) -> None:
        """Say that nobody searches: the pose must be given."""
        self._enter(State.NOT_LOCALISED)

    def start(self) -> None:
        """Take a verified pose on probation."""
        self._enter(State.PROBATION)

    def lose(self) -> None:
        """Give the pose up."""
        self.num_losses += 1
        self._enter(State.LOST)

    def align(self, is_good: bool, step_s: float = 0.0) -> None:
        """Count an accepted alignment; `is_good` is false when it was accepted with care."""
        self._num_good = self._num_good + 1 if is_good else 0
        if self.state is State.PROBATION and self._num_good >= self.probation_frames:
            self._enter(State.TRACKING)
        elif self.state is State.TRACKING:
            self._forgive(step_s)
            if not is_good:
                self._enter(State.DEGRADED)
        elif self.state is State.DEGRADED and self._num_good >= self._params.recovery_frames:
            self._enter(State.TRACKING)

    def refuse(self, blind_s: float, is_certain: bool) -> None:
        """Count a frame without alignment, `blind_s` after the last one; lost when too long or too uncertain."""
        self._num_good = 0
        if self.state is State.PROBATION or blind_s > self._params.max_blind_s or not is_certain:
            self.lose()
        elif self.state is State.TRACKING:
            self._enter(State.DEGRADED)

    def _forgive(self, step_s: float) -> None:
        """Forget one loss after each long stretch of tracking."""
        self._tracking_s += step_s
        if self._tracking_s > self._params.forgive_s:
            self._tracking_s, self.num_losses = 0.0, max(0, self.num_losses - 1)

    def _enter(self, state: State) -> None:
        self.state = state
        self._num_good, self._tracking_s = 0, 0.0


def status_of(state: State, stamp_ns: int, finding: Finding, age: float, place: Place | None = None) -> Status:
    """Return the status with the evidence of an attempt to place the image, where there was one."""
    words = str(finding.reason), finding.value, finding.limit, finding.remedy
    status = Status(state, *words, age=max(age, 0.0), stamp_ns=stamp_ns)
    if place is None or place.alignment is None:
        return status
    return replace(
        status,
        quality=place.verdict.quality,
        references=place.choice.ids,
        overlap=place.alignment.overlap,
        inlier_share=place.alignment.inlier_share,
        mad=place.alignment.mad,
        iterations=place.alignment.iterations,
    )
