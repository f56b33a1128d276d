"""The node around a localiser: images in, pose and status out. Every image is answered by a status.

A localiser's node derives from it and says how to localise, search and forget; the rest is the same for all.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import deque
from dataclasses import replace
from typing import ClassVar

from geometry_msgs.msg import PoseWithCovarianceStamped
from sphere_nav_msgs.srv import Relocalize
from std_srvs.srv import Trigger

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.odometry import Agreement
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import (
    FINE,
    FOLLOWING,
    INPUT_REMEDIES,
    BaseEstimate,
    Reason,
    State,
    Status,
    Verdict,
    describe_status,
    status_of,
)
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.intake import Cameras
from sphere_nav.ros.camera.stream import Picture
from sphere_nav.ros.clocks import ClockWatch, check_stamp
from sphere_nav.ros.constants import (
    FIRST_IMAGE_S,
    LOG_PERIOD_S,
    MAX_LOST_SHARE,
    NUM_COUNTED,
    OFFER_PERIOD_NS,
    STANDSTILL_S,
    WATCH_PERIOD_S,
)
from sphere_nav.ros.localizer.pose_outputs import PoseOutputs
from sphere_nav.ros.node import ERROR, OK, WARN, ManagedNode

OWN, OTHER = 0, 1  # whose pose it is
CLOCK_STANDS = "/clock stands still", "start the simulator or the player again; the pose goes on with its time"


class LocalizerNode(ManagedNode):
    """Converts, asks the localiser, converts back."""

    NO_MAP: ClassVar[str]  # what to do where there is nothing to localise in
    params: NodeParams

    # --- what a localiser says
    @abstractmethod
    def localize(self, picture: Picture) -> BaseEstimate:
        """Localise one image."""

    @abstractmethod
    def refuse(self, stamp_ns: int, finding: Verdict) -> Status:
        """Return the status of an image that cannot be used."""

    @abstractmethod
    def relocalize(self, given: tuple[SE3, Array] | None) -> BaseEstimate | None:
        """Search around a pose of the base with its covariance, or everywhere; None: with the images to come.

        ValueError for a pose off the map, or where there is no map.
        """

    @abstractmethod
    def silence(self, elapsed_s: float, finding: Verdict) -> Status | None:
        """Return what to say so long after the last usable image, if that is too long: `finding`, or a TIMEOUT."""

    @abstractmethod
    def forget(self) -> None:
        """Forget pose and stream; the pose is searched anew."""

    @property
    @abstractmethod
    def is_ready(self) -> bool:
        """Whether a given pose can be used at once, and need not be given again with the next image."""

    @property
    def has_map(self) -> bool:
        """Whether there is something to localise in."""
        return True

    @property
    def map_id(self) -> str:
        """The name of the map in use; empty where it has none."""
        return ""

    def prepare(self, picture: Picture) -> None:
        """Make what needs to know the camera's place, before the first image."""

    def make_intake(self) -> Cameras:
        """Subscribe to the camera."""
        return Cameras(self.endpoints, self.params, self.on_picture, self.on_refusal)

    # --- what they share
    def configure(self) -> None:
        """Open topics and services."""
        self.given: tuple[SE3, Array] | None = None  # pose of the base that waits for the first image
        self.refusal = FINE  # of the last image
        self.losses: deque[int] = deque(maxlen=NUM_COUNTED)
        self.num_lost, self.heard_ns = 0, 0  # heard: when the last usable image was answered, on the node's own clock
        self.waits_since_ns = self.own_ns()
        self.intake = self.make_intake()
        self.outputs = PoseOutputs(self.endpoints, self.params, self.intake.odometry, lambda: self.map_id)
        self.add_subscription(
            "initialpose", PoseWithCovarianceStamped, self.on_initial_pose, qos.STATE, is_required=False
        )
        self.agreement = Agreement()
        self.offered_ns = 0  # stamp of the last pose of the other localiser that was tried
        self.add_subscription("other/pose", PoseWithCovarianceStamped, self.on_other_pose, qos.STATE, is_required=False)
        self.add_service("~/relocalize", Relocalize, self.on_relocalize)
        self.add_service("~/reset", Trigger, self.on_reset)
        self.clock_watch = ClockWatch(give_up=STANDSTILL_S, patience=STANDSTILL_S, max_look=2 * WATCH_PERIOD_S)
        self.add_timer(WATCH_PERIOD_S, self.on_watch, is_wall=True)

    def activate(self) -> None:
        """Wait for the first image from now on; what is missing first is said first."""
        self.waits_since_ns = self.own_ns()
        if not self.has_map:
            self.outputs.tell(self.refuse(self.now_ns(), FINE))

    def lack(self) -> str:
        """Return how to give it a map where it has none, else which calibration it lacks."""
        return self.intake.lack if self.has_map else f"a map ({self.NO_MAP})"

    def clock_jumped(self) -> None:
        """Forget everything with a stamp."""
        self.intake.clear()
        self.outputs.clear()
        self.agreement.clear()
        self.offered_ns, self.heard_ns, self.refusal, self.waits_since_ns = 0, 0, FINE, self.own_ns()
        self.forget()

    # --- images
    def on_picture(self, picture: Picture) -> None:
        """Localise one image and publish the result, or at least the status."""
        started = time.perf_counter()
        self.prepare(picture)
        if self.given is not None and self.is_ready:
            self.use_given(self.given)
        estimate = self.localize(picture)
        milliseconds = (time.perf_counter() - started) * 1e3
        status = self.add_doubts(replace(estimate.status, milliseconds=milliseconds))
        if status.reason == Reason.BAD_STAMP:
            self.tell_refused(status, Verdict(Reason.BAD_STAMP, status.value, status.limit))
            return
        self.heard_ns, self.refusal = self.own_ns(), FINE  # after the work: time spent here is no silence
        if estimate.T_map_base is not None and estimate.covariance is not None:
            self.compare(OWN, picture.stamp_ns, estimate.T_map_base, estimate.covariance)
        self.outputs.publish(replace(estimate, status=status))

    def on_refusal(self, stamp_ns: int, finding: Verdict) -> None:
        """Answer an image that cannot be used."""
        now_ns = self.now_ns()
        if finding.reason is Reason.BAD_STAMP:
            stamp_ns = min(stamp_ns, now_ns)  # nobody else shall believe it, either
        self.tell_refused(self.refuse(stamp_ns, finding), finding)
        if finding.reason is not Reason.BAD_STAMP:
            self.heard_ns = self.own_ns()

    def tell_refused(self, status: Status, finding: Verdict) -> None:
        """Tell the status of a refused image; after too many of them the pose is not current any more."""
        self.refusal = finding
        self.outputs.tell(self.find_silence() or status)

    def add_doubts(self, status: Status) -> Status:
        """Say so where many images are lost before they can be answered, or one of several cameras delivers nothing.

        Where something worse is wrong, that is said.
        """
        num_lost = self.intake.num_lost
        self.losses.append(num_lost - self.num_lost)
        self.num_lost = num_lost
        share = sum(self.losses) / (sum(self.losses) + len(self.losses))
        overrun = Verdict(Reason.OVERRUN, share, MAX_LOST_SHARE, "share of images lost in queue or network")
        doubt = overrun if share > MAX_LOST_SHARE else self.intake.fault
        if status.reason or doubt.reason is Reason.NONE:
            return status
        remedy = doubt.remedy(INPUT_REMEDIES)
        return replace(status, reason=str(doubt.reason), value=doubt.value, limit=doubt.limit, remedy=remedy)

    # --- silence
    def on_watch(self) -> None:
        """Say so when images stay away, or none of them can be used, or time itself stands still."""
        self.report("/clock", OK, "goes on")
        self.clock_watch.observe(self.own_ns(), self.steady_ns(), self.has_clock)
        status = self.find_silence() or self.find_standstill()
        if status is not None:
            self.outputs.tell(status)

    def has_clock(self) -> bool:
        """Return whether a clock that stands has a publisher, which waits for somebody; report it."""
        names = self.publishers_of("/clock")
        self.report("/clock", WARN, f"stands still, held by {', '.join(names) or 'nobody'}")
        return bool(names)

    def find_standstill(self) -> Status | None:
        """Return what to say of a clock that nobody publishes any more: the pose is kept, its vehicle stands, too."""
        if not self.clock_watch.is_over:
            return None
        told = self.outputs.state
        state = {State.UNCONFIGURED: State.NOT_LOCALISED, State.TRACKING: State.DEGRADED}.get(told, told)
        return status_of(
            state, self.now_ns(), Verdict(Reason.TIMEOUT, self.clock_watch.abandoned, STANDSTILL_S, *CLOCK_STANDS)
        )

    def find_silence(self) -> Status | None:
        """Return what to say of the time since the last usable image, judged by arrival, which no stamp moves."""
        now_ns = self.own_ns()
        if not self.has_map:
            return self.refuse(self.now_ns(), FINE)
        if self.heard_ns:
            return self.silence((now_ns - self.heard_ns) * 1e-9, self.refusal)
        waited = (now_ns - self.waits_since_ns) * 1e-9
        if waited <= FIRST_IMAGE_S:
            return None
        return status_of(State.NOT_LOCALISED, self.now_ns(), Verdict(Reason.TIMEOUT, waited, FIRST_IMAGE_S))

    # --- poses that are given
    def needs_help(self) -> bool:
        """Whether another localiser's pose is of use: it can be tried, and there is none."""
        return self.is_ready and self.outputs.state not in FOLLOWING

    def on_other_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Compare a pose of another localiser with ours; search around it where there is none."""
        given = conversions.pose_with_covariance_to_se3(message, self.params.map_frame)
        stamp = conversions.stamp_ns(message)
        check_stamp(stamp, self.now_ns(), "pose of the other localiser")
        self.compare(OTHER, stamp, *given)
        if self.needs_help() and not 0 <= stamp - self.offered_ns < OFFER_PERIOD_NS:
            self.offered_ns = stamp
            self.tell(self.relocalize(given))

    def compare(self, source: int, stamp_ns: int, T_map_base: SE3, covariance: Array) -> None:
        """Report what a pose, of ours or of the other localiser, is compared with: ERROR beyond both covariances."""
        found = self.agreement.add(source, stamp_ns, T_map_base, covariance)
        if found is not None:
            level, word = (ERROR, "contradicts") if found.is_contradiction else (OK, "")
            values = {"distance": found.distance, "metres": found.meters, "radians": found.radians}
            self.endpoints.tell("agreement", level, f"the other localiser {word or 'agrees'}: {found}", word, **values)

    def on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Search around a given pose of the base; ValueError for a wrong frame, NaN, or a pose off the map."""
        given = conversions.pose_with_covariance_to_se3(message, self.params.map_frame)
        self.tell(self.relocalize(given))
        self.given = None if self.is_ready else given  # once more when it can be used

    def use_given(self, given: tuple[SE3, Array]) -> None:
        """Search around a pose that was given before the first image; one off the map is named and left."""
        self.given = None
        try:
            self.relocalize(given)
        except ValueError as error:
            self.log.error(f"initialpose: refused: {error}", every=LOG_PERIOD_S)

    def tell(self, estimate: BaseEstimate | None) -> None:
        """Tell what a search has found at once."""
        if estimate is not None:
            self.outputs.tell(estimate.status)

    # --- calls of an operator
    def on_relocalize(self, request: Relocalize.Request, response: Relocalize.Response) -> Relocalize.Response:
        """Search with the last image, and go on with the next ones where it is not found."""
        started, frame = time.perf_counter(), self.params.map_frame
        guess = conversions.pose_with_covariance_to_se3(request.guess, frame) if request.has_guess else None
        estimate = self.relocalize(guess)
        response.seconds = time.perf_counter() - started
        if estimate is None:
            response.message = "the search begins with the next image"
            return response
        self.tell(estimate)
        status = estimate.status
        response.success, response.message = status.state in FOLLOWING, describe_status(status)
        response.quality, response.references = status.quality, list(status.references)
        pose, covariance = estimate.T_map_base, estimate.covariance
        if response.success and pose is not None and covariance is not None:
            response.pose = conversions.se3_to_pose_with_covariance(pose, covariance, status.stamp_ns, frame)
        return response

    def on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the pose, the stream and the calibration."""
        self.clock_jumped()
        self.intake.forget_camera()
        response.success, response.message = True, "nothing is known of the pose"
        return response
