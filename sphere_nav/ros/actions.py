"""Actions as services are: every callback is guarded, an answer always comes, and nothing waits in a loop.

rclpy runs a goal as a coroutine; one that awaits something is resumed at every turn of the executor, a core at full
load. Here a goal is accepted, told to the node, and ended by the node when it is done. Where the node raises on a
request, the goal is rejected; where it raises on an accepted one, the goal is aborted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer
from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.node import Node

from sphere_nav.ros.conversions.frames import plain_frames
from sphere_nav.ros.endpoints import GoalCalls
from sphere_nav.ros.service import one_line


class ActionGoal:
    """A goal that was accepted: feedback while it lasts, one end."""

    def __init__(self, server: GuardedActionServer, handle: ServerGoalHandle) -> None:
        self._server, self._handle = server, handle
        self.request: Any = plain_frames(handle.request)

    @property
    def is_canceled(self) -> bool:
        """Whether the client wants it to end."""
        return bool(self._handle.is_cancel_requested)

    def publish(self, feedback: Any) -> None:
        """Tell the client how it goes."""
        if self._handle.is_active:
            self._handle.publish_feedback(feedback)

    def finish(self, result: Any, *, success: bool) -> None:
        """End it: succeeded, canceled where the client wanted that, else aborted."""
        if not self._handle.is_active:
            return
        if success:
            self._handle.succeed()
        elif self.is_canceled:
            self._handle.canceled()
        else:
            self._handle.abort()
        self._server.conclude(self._handle, result)


class GuardedActionServer(ActionServer):
    """An action server whose goals are ended by `ActionGoal.finish`."""

    def __init__(
        self,
        node: Node,
        kind: type[Any],
        name: str,
        calls: GoalCalls,
        report: Callable[[str, BaseException], None],
    ) -> None:
        """`report` gets what a callback raised."""
        self.kind, self._begin, self._report, self._name = kind, calls.begin, report, name
        self._goals: dict[bytes, ActionGoal] = {}

        def accept(request: Any) -> GoalResponse:
            try:
                calls.check(plain_frames(request))
            except Exception as error:
                report(f"{name}: goal rejected", error)
                return GoalResponse.REJECT
            return GoalResponse.ACCEPT

        def end(handle: ServerGoalHandle) -> CancelResponse:
            goal = self._goals.get(bytes(handle.goal_id.uuid))
            try:
                if goal is not None:
                    calls.cancel(goal)
            except Exception as error:
                report(f"{name}: cancel", error)
            return CancelResponse.ACCEPT

        super().__init__(node, kind, name, self._nothing, goal_callback=accept, cancel_callback=end)

    @staticmethod
    def _nothing(handle: ServerGoalHandle) -> None:
        """Be what rclpy wants to execute."""

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Callable[..., Any] | None) -> None:
        """Begin a goal that was accepted, in place of a coroutine that waits for its end."""
        goal = ActionGoal(self, goal_handle)
        self._goals[bytes(goal_handle.goal_id.uuid)] = goal
        try:
            self._begin(goal)
        except Exception as error:
            self._report(f"{self._name}: goal aborted", error)
            result = self.kind.Result()
            if hasattr(result, "reason"):
                result.reason = one_line(error)
            goal.finish(result, success=False)

    def conclude(self, handle: ServerGoalHandle, result: Any) -> None:
        """Give the client its result; the goal has a terminal state."""
        self._goals.pop(bytes(handle.goal_id.uuid), None)
        super().notify_execute(handle, lambda _: result)
