"""What an operator can ask the node for: start, stop, pause, resume, emergency stop."""

from __future__ import annotations

from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from node_kit import qos
from node_kit.node import ManagedNode
from path_follower.follower import Follower


class OperatorCalls:
    """Services, each answered by what was done or why not, and the topic `emergency_stop`."""

    def __init__(self, node: ManagedNode, follower: Follower) -> None:
        """Serve and listen."""
        self.node, self.follower = node, follower
        node.add_service("start", Trigger, self.on_start)
        node.add_service("stop", Trigger, self.on_stop)
        node.add_service("pause", Trigger, self.on_pause)
        node.add_service("resume", Trigger, self.on_resume)
        node.add_subscription("emergency_stop", Bool, self.on_emergency, qos.STATE, is_required=False)

    def on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Arm."""
        return answered(response, self.follower.start(self.node.now_ns()))

    def on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Brake and disarm."""
        self.follower.stop()
        return answered(response, "")

    def on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Brake and wait for `resume`."""
        return answered(response, self.follower.pause())

    def on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go on after a pause."""
        return answered(response, self.follower.resume(self.node.now_ns()))

    def on_emergency(self, message: Bool) -> None:
        """Press or release the emergency stop."""
        self.follower.emergency(is_pressed=message.data)


def answered(response: Trigger.Response, refusal: str) -> Trigger.Response:
    """Fill the answer of a Trigger: done, or refused and why."""
    response.success, response.message = not refusal, refusal
    return response
