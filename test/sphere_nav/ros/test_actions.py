"""An action over real DDS: whatever its callbacks raise, the client gets an answer, and the node goes on."""

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from sphere_nav_msgs.action import Navigate

from sphere_nav.ros.endpoints import GoalCalls
from sphere_nav.ros.node import ManagedNode
from worlds.desk import ShellDesk


class Walker(ManagedNode):
    NAME = "walker"

    def configure(self):
        self.goals, self.canceled = [], []
        self.endpoints.add_action("walk", Navigate, GoalCalls(self.check, self.begin, self.cancel))

    def check(self, request):
        assert request.pose.header.frame_id == "map"
        if request.place == "nowhere":
            raise ValueError("place: expected one that exists")
        if request.place == "broken":
            raise ZeroDivisionError

    def begin(self, goal):
        if goal.request.place == "late":
            raise KeyError("late")
        assert goal.request.pose.header.frame_id == "map"
        self.goals.append(goal)

    def cancel(self, goal):
        self.canceled.append(goal)
        raise OverflowError("cancel")


@pytest.fixture
def walk(open_desk):
    walk = open_desk(Walk)
    yield walk
    walk.client.destroy()
    walk.shell.stop()


class Walk(ShellDesk):
    def __init__(self):
        super().__init__(Walker)
        self.feedback = []
        assert self.shell.start()
        self.client = ActionClient(self.peer, Navigate, "walk")
        self.until(self.client.server_is_ready)

    def ask(self, place):
        request = Navigate.Goal(place=place)
        request.pose.header.frame_id = "/map"  # as of ROS 1
        return self.done(self.client.send_goal_async(request, lambda message: self.feedback.append(message.feedback)))


def test_goals_of_every_fate(walk):
    node, failures = walk.shell.node, walk.shell.failures
    # what cannot be is rejected, and a mistake of ours, too, which is counted
    assert not walk.ask("nowhere").accepted
    assert failures.num_failed == 0
    assert not walk.ask("broken").accepted
    assert (failures.num_failed, "ZeroDivisionError" in failures.last_failure) == (1, True)
    # what raises as it begins is aborted, with the reason
    late = walk.ask("late")
    assert late.accepted
    answer = walk.done(late.get_result_async())
    assert (answer.status, answer.result.reason) == (GoalStatus.STATUS_ABORTED, "KeyError: 'late'")
    # one that is done: feedback, result
    handle = walk.ask("home")
    node.goals[0].publish(Navigate.Feedback(edge="7"))
    walk.until(lambda: walk.feedback)
    node.goals[0].finish(Navigate.Result(success=True, distance=5.0), success=True)
    node.goals[0].finish(Navigate.Result(success=False), success=False)  # has ended already
    node.goals[0].publish(Navigate.Feedback(edge="8"))
    answer = walk.done(handle.get_result_async())
    assert (answer.status, answer.result.distance, walk.feedback[0].edge) == (GoalStatus.STATUS_SUCCEEDED, 5.0, "7")
    # one that is canceled, though the callback raises
    handle = walk.ask("home")
    assert walk.done(handle.cancel_goal_async()).goals_canceling
    assert node.canceled == [node.goals[1]]
    node.goals[1].finish(Navigate.Result(reason="canceled"), success=False)
    assert walk.done(handle.get_result_async()).status == GoalStatus.STATUS_CANCELED
    assert len(walk.feedback) == 1
