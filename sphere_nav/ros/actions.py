"""Actions as services are: every callback is guarded, an answer always comes, and nothing waits in a loop.

rclpy runs a goal as a coroutine; one that awaits something is resumed at every turn of the executor, a core at full
load. Here a goal is accepted, told to the node, and ended by the node when it is done. Where the node raises on a
request, the goal is rejected; where it raises on an accepted one, the goal is aborted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakValueDictionary

from rclpy.action import ActionServer
from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.node import Node

from sphere_nav.ros.conversions.headers import plain_frames
from sphere_nav.ros.endpoints import GoalCalls
from sphere_nav.ros.service import one_line


class ActionGoal:
    """A goal that was accepted: feedback while it lasts, one end."""

    def __init__(self, handle: ServerGoalHandle) -> None:
        self._handle, self._is_over = handle, False
        self.request: Any = plain_frames(handle.request)

    def publish(self, feedback: Any) -> None:
        """Tell the client how it goes."""
        if not self._is_over:
            self._handle.publish_feedback(feedback)

    def finish(self, result: Any, *, success: bool) -> None:
        """End it: succeeded, canceled where the client wanted that, else aborted."""
        if self._is_over:
            return
        self._is_over = True

        def end(handle: ServerGoalHandle) -> Any:
            if success:
                handle.succeed()
            elif handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        self._handle.execute(end)


def serve_action(
    node: Node, kind: type[Any], name: str, calls: GoalCalls, report: Callable[[str, BaseException], None]
) -> ActionServer:
    """Return an action server whose goals are ended by `ActionGoal.finish`; `report` gets what a callback raised."""
    goals: WeakValueDictionary[bytes, ActionGoal] = WeakValueDictionary()  # the node keeps those under way

    def attempt(where: str, call: Callable[[], None]) -> Exception | None:
        try:
            call()
        except Exception as error:
            report(f"{name}: {where}", error)
            return error
        return None

    def accept(request: Any) -> GoalResponse:
        error = attempt("goal rejected", lambda: calls.check(plain_frames(request)))
        return GoalResponse.ACCEPT if error is None else GoalResponse.REJECT

    def begin(handle: ServerGoalHandle) -> None:
        goal = goals[bytes(handle.goal_id.uuid)] = ActionGoal(handle)
        error = attempt("goal aborted", lambda: calls.begin(goal))
        if error is not None:
            result = kind.Result()
            if hasattr(result, "reason"):
                result.reason = one_line(error)
            goal.finish(result, success=False)

    def cancel(handle: ServerGoalHandle) -> CancelResponse:
        attempt("cancel", lambda: calls.cancel(goals[bytes(handle.goal_id.uuid)]))
        return CancelResponse.ACCEPT

    return ActionServer(
        node, kind, name, begin, goal_callback=accept, handle_accepted_callback=begin, cancel_callback=cancel
    )
