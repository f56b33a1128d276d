"""Who else there is: publishers of what the vehicle is driven by, the emergency stop, and the guard behind."""

from __future__ import annotations

from collections.abc import Callable

from sphere_nav_msgs.msg import GuardStatus
from std_msgs.msg import Bool

from path_follower.constants import GUARD_SILENCE_NS, HEARD_BEFORE_NS
from path_follower.guard.guard import AWAITED
from path_follower.reasons import FINE, StopReason
from sphere_nav.localization.status import Verdict
from sphere_nav.ros import qos
from sphere_nav.ros.endpoints import ERROR, OK, Endpoints


class EmergencyStop:
    """The topic `emergency_stop`: heard whatever QoS its publisher offers, and whenever it was latched."""

    def __init__(self, endpoints: Endpoints, press: Callable[[bool], None]) -> None:
        """`press` is called with every message that counts: pressed or released."""
        self._endpoints, self._press = endpoints, press
        self.names: list[str] = []
        self._is_pressed = self._is_held = False  # held: one of several pressed, and only a press releases it
        self._since_ns, self._heard_ns = -1, -(10**18)
        self._topics = endpoints.hear_always("emergency_stop", Bool, self._hear)

    def take(self) -> None:
        """Hear at once what waits for its turn behind other work."""
        for topic in self._topics:
            self._endpoints.take_waiting(topic)

    def _hear(self, message: Bool) -> None:
        """Press or release; what another publisher said all the time does not release what one pressed that has gone.

        It does once it has pressed, too.
        """
        self._heard_ns = self._endpoints.steady_ns()
        are_several = (message.data or self._is_pressed) and len(self._endpoints.publishers_of("emergency_stop")) > 1
        self._is_held = are_several or (self._is_held and not message.data)
        if message.data or not self._is_held:
            self._is_pressed = bool(message.data)
            self._press(self._is_pressed)

    def look(self) -> None:
        """See who publishes it; a change of those has to be heard anew."""
        names = self._endpoints.publishers_of("emergency_stop")
        if names != self.names:
            is_first = self._since_ns < 0  # heard, perhaps, long before this look: as the node became active
            self.names, self._since_ns = names, 0 if is_first else self._endpoints.steady_ns()
        self._is_held = self._is_held or (self._is_pressed and len(names) > 1)

    @property
    def doubt(self) -> str:
        """Why a start cannot rely on it; empty where there is no publisher, or one that was heard."""
        if len(self.names) > 1:
            return f"published by {', '.join(self.names)}: expected one, which speaks for all"
        if self.names and self._heard_ns < self._since_ns - HEARD_BEFORE_NS:
            return f"{self.names[0]} publishes emergency_stop, but nothing of it was heard: let it say what holds"
        return ""


class Peers:
    """What other nodes do that the vehicle must not drive with, as one verdict."""

    def __init__(self, endpoints: Endpoints, topic: str, press: Callable[[bool], None]) -> None:
        """`topic`: what the vehicle is driven by."""
        self._endpoints = endpoints
        status = "homing/status" if topic == "homing/direction" else "status"
        self._sources = {
            topic: StopReason.POSE_SOURCE,
            status: StopReason.STATUS_SOURCE,
            "cmd_vel": StopReason.COMMAND_SOURCE,
        }
        self.emergency = EmergencyStop(endpoints, press)
        self._relied_on: list[str] = []  # who published the emergency stop at the start
        self._guard: GuardStatus | None = None
        self._guard_ns = self._started_ns = 0
        self._published = FINE
        endpoints.add_subscription("command_guard/status", GuardStatus, self._hear_guard, qos.STATE, is_required=False)

    def _hear_guard(self, message: GuardStatus) -> None:
        self._guard, self._guard_ns = message, self._endpoints.steady_ns()

    def begin(self) -> Verdict:
        """Return why a drive may not begin now, or FINE; what the guard waits for, a start gives."""
        self.look()
        self._relied_on, self._started_ns = self.emergency.names, self._endpoints.steady_ns()
        doubt = self.emergency.doubt
        return Verdict(StopReason.EMERGENCY_STOP, detail=doubt) if doubt else self.judge()

    def look(self) -> None:
        """Look who publishes: more than one pose, status or command cannot be followed."""
        self.emergency.look()
        self._published = FINE
        for topic, reason in self._sources.items():
            names = self._endpoints.speakers_of(topic)
            text = f"{topic}: {', '.join(names) or 'no publisher'}"
            self._endpoints.report(f"publishers {topic}", ERROR if len(names) > 1 else OK, text)
            if len(names) > 1 and self._published is FINE:
                self._published = Verdict(reason, len(names), 1, f"{topic} is published by {', '.join(names)}")

    def judge(self) -> Verdict:
        """Return why the vehicle may not move, or FINE."""
        names = self.emergency.names
        if self._relied_on and len(names) != 1:
            found = f"published by {', '.join(names)}" if names else f"{self._relied_on[0]} publishes it no more"
            return Verdict(StopReason.EMERGENCY_STOP, detail=found)
        return self._judge_guard() if self._published is FINE else self._published

    def _judge_guard(self) -> Verdict:
        if self._guard is None:
            return FINE
        now, guard = self._endpoints.steady_ns(), self._guard
        if now - self._guard_ns > GUARD_SILENCE_NS:
            silent = (now - self._guard_ns) / 1e9
            return Verdict(StopReason.COMMAND_GUARD, silent, GUARD_SILENCE_NS / 1e9, f"silent for {silent:.2g} s")
        is_awaited = guard.reason in AWAITED and now - self._started_ns < GUARD_SILENCE_NS
        if not guard.reason or is_awaited:
            return FINE
        return Verdict(StopReason.COMMAND_GUARD, detail=f"{guard.reason}: {guard.detail}")
