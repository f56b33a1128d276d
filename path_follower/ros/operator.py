"""What an operator can ask the node for: start, stop, pause, resume."""

from __future__ import annotations

from collections.abc import Callable

from std_srvs.srv import Trigger

from path_follower.ros.front import LoopRequests
from sphere_nav.ros.endpoints import Endpoints

CALLS = ("start", "stop", "pause", "resume")


def offer_calls(endpoints: Endpoints, loop: LoopRequests) -> None:
    """Offer the services, each answered by what was done or why not."""

    def answering(name: str) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.message = loop.ask(name)
            response.success = not response.message
            return response

        return handle

    for name in CALLS:
        endpoints.add_service(f"~/{name}", Trigger, answering(name))
