"""What an operator can ask the node for: start, stop, pause, resume, emergency stop."""

from __future__ import annotations

from collections.abc import Callable

from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from path_follower.follower import Follower
from sphere_nav.ros import qos
from sphere_nav.ros.endpoints import Endpoints


class OperatorCalls:
    """Services, each answered by what was done or why not, and the topic `emergency_stop`."""

    def __init__(self, endpoints: Endpoints, follower: Follower) -> None:
        """Offer the services, subscribe to the emergency stop."""
        self._follower = follower
        endpoints.add_service("~/start", Trigger, answering(lambda: follower.start(endpoints.own_ns())))
        endpoints.add_service("~/stop", Trigger, answering(follower.stop))
        endpoints.add_service("~/pause", Trigger, answering(follower.pause))
        endpoints.add_service("~/resume", Trigger, answering(lambda: follower.resume(endpoints.own_ns())))
        endpoints.add_subscription("emergency_stop", Bool, self.on_emergency, qos.STATE, is_required=False, silence=0.0)

    def on_emergency(self, message: Bool) -> None:
        """Press or release the emergency stop."""
        self._follower.emergency(is_pressed=message.data)


def answering(action: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    """Return the handler of a Trigger that calls `action`: an empty answer means done, any other says why not."""

    def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = action()
        response.success = not response.message
        return response

    return handle
