"""The simulator as a ROS node: commands in; clock, images, spheres, odometry and the truth out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rosgraph_msgs.msg import Clock
from sphere_nav_msgs.msg import SimulationFault
from sphere_nav_msgs.srv import SetFault, Teleport
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from cycab_sim.params import SimParams
from cycab_sim.ros.outputs import Outputs
from cycab_sim.runner import ANSWER, PAUSE, LockStep, Runner
from cycab_sim.sensors.faults import SECOND
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.node import OK, WARN, ManagedNode, Publisher
from sphere_nav.ros.run import run

WAITING_PERIOD = 10.0  # s between two lines about what time waits for


class CycabSim(ManagedNode):
    """Runs a `Simulator` in a thread and publishes what it hands out."""

    NAME = "cycab_sim"
    PARAMS = SimParams
    LARGE_MESSAGES = True
    params: SimParams

    def configure(self) -> None:
        """Build the world, open topics and services."""
        is_answered = self.params.camera.period > 0.0 and self.params.has_stamped_command
        if self.params.clock.is_strict and self.params.mode == "drive" and not is_answered:
            raise ValueError(
                "clock.is_strict: expected has_stamped_command and camera.period > 0, found one of them off"
            )
        self.log.info(f"building the {self.params.world}; the first image may compile kernels for a minute")
        self.simulator = Simulator(self.params)
        self.lock_step = LockStep(self.params.clock, self.params.camera.period)
        self.runner = Runner(self.simulator, self.lock_step, self.hand_out, self.find_lack, self.tell_waiting)
        self.clock = self.add_publisher("/clock", Clock)
        self.outputs = Outputs(self.endpoints, self.simulator)
        self.taught = self.add_publisher("taught", Bool, qos.LATCHED)
        kind = TwistStamped if self.params.has_stamped_command else Twist
        self.add_subscription("cmd_vel", kind, self.on_command, qos.DEEP, is_required=False)
        self.paused = self.add_publisher("paused", Bool, qos.LATCHED)
        self.add_service("~/resume", Trigger, self.on_resume)
        self.add_service("~/teleport", Teleport, self.on_teleport)
        self.add_service("~/set_fault", SetFault, self.on_set_fault)
        self.has_told = self.has_shown = self.is_paused = False
        self.report("simulation", OK, "ready")

    def activate(self) -> None:
        """Let time pass."""
        self.outputs.publish_statics()
        self.taught.publish(Bool(data=self.has_told))
        self.runner.start()

    def deactivate(self) -> None:
        """Stop time."""
        self.runner.stop()

    def on_command(self, message: Any) -> None:
        """Hand on a Twist or TwistStamped; a stamp of 0 means now."""
        now = self.simulator.time_ns
        stamp = conversions.stamp_ns(message) if self.params.has_stamped_command else now
        twist = message.twist if self.params.has_stamped_command else message
        self.lock_step.offer(VehicleCommand(twist.linear.x, twist.angular.z), stamp or now, now)

    def hand_out(self, name: str) -> int | None:
        """Publish one output at the present instant, in the simulation's thread; return the stamp of an image sent."""
        if name == "clock":
            self._publish_clock(self.simulator.time_ns)
            return self.outputs.publish_late()
        begun, is_strict = self.steady_ns(), self.params.clock.is_strict
        if name == "camera" and is_strict:
            self.wait_for_subscribers([self.outputs.odom])  # an image shall not overtake the odometry of its instant
        stamp = self.outputs.publish(name)
        if not self.has_shown and name in ("camera", "sphere", "rig"):
            self.has_shown = True
            self.log.info(f"the first image took {(self.steady_ns() - begun) / SECOND:.1f} s; time passes")
        if name == "rig" and is_strict:
            self.wait_for_subscribers(self.outputs.images.values())
        return stamp

    # --- lock-step without limit
    def find_lack(self) -> str:
        """Return for whom time waits before it passes: those who see the images, and who answers them."""
        lacks = [f"a subscription of {name}" for name, one in self.outputs.images.items() if not one.num_subscriptions]
        if self.params.mode == "drive" and not self.publishers_of("cmd_vel"):
            lacks.append("a publisher of cmd_vel")
        return ", ".join(lacks)

    def tell_waiting(self, what: str) -> None:
        """Say what time waits for, and show it again to those who joined since it stands; the simulation's thread."""
        now, names = self.simulator.time_ns, ", ".join(self.publishers_of("cmd_vel"))
        text = f"time waits at {now / SECOND:.2f} s for {what}" + f" (cmd_vel: {names})" * (what == ANSWER)
        self.clock.publish(Clock(clock=conversions.ns_to_time(now)))
        self.report("simulation", OK, text, time=now / SECOND, is_waiting_for_commands=what == ANSWER)
        self.log.info(text, every=WAITING_PERIOD, key=what)
        if what == PAUSE and not self.is_paused:
            self.is_paused = True
            self.paused.publish(Bool(data=True))

    def wait_for_subscribers(self, publishers: Iterable[Publisher]) -> None:
        """Wait until all reliable subscriptions have what was published: a slow one loses nothing."""
        for publisher in publishers:
            while publisher.num_subscriptions and not self.runner.is_stopping:
                if publisher.wait_for_acknowledgement(WAITING_PERIOD):
                    break

    def on_resume(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Let time go on after a pause."""
        if not self.is_paused:
            raise ValueError("nothing to resume: time is not paused")
        self.runner.resumed.set()
        response.success = True
        return response

    def _publish_clock(self, now: int) -> None:
        self.clock.publish(Clock(clock=conversions.ns_to_time(now)))
        missed = self.lock_step.num_missed
        level, text = (WARN, f"no command came in time after {missed} images") if missed else (OK, "running")
        self.report("simulation", level, text, time=now / SECOND, is_waiting_for_commands=self.lock_step.is_engaged)
        if missed:
            self.log.warning(text, every=10.0, key="missed")
        if self.simulator.is_taught and not self.has_told:
            self.has_told = True
            self.taught.publish(Bool(data=True))

    def on_teleport(self, request: Any, response: Any) -> Any:
        """Put the car elsewhere, between two steps."""
        T_world_base = conversions.pose_to_se3(request.pose)
        x, y, _ = T_world_base.translation.tolist()
        with self.runner.lock:
            self.simulator.teleport(x, y, float(T_world_base.yaw), request.speed)
        response.success = True
        return response

    def on_set_fault(self, request: Any, response: Any) -> Any:
        """Clear faults, add one, between two steps, and answer with those in force."""
        faults, wanted = self.simulator.faults, request.fault
        with self.runner.lock:
            now = self.simulator.time_ns
            if request.clear:
                faults.clear()
            try:
                if wanted.kind:
                    faults.add(wanted.target, wanted.kind, wanted.magnitude, wanted.start, wanted.duration, now)
                response.success = True
            except ValueError as error:
                response.message = str(error)
        response.active = [SimulationFault(**fault) for fault in faults.described(now)]
        return response


def main() -> int:
    """Run the node."""
    return run(CycabSim)
