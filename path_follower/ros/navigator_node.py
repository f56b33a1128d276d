"""The node `route_navigator`: a place of a network of taught paths in, one path at a time for path_follower out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus, NavigatorStatus
from sphere_nav_msgs.srv import CloseEdge, Drive, PlanRoute
from std_msgs.msg import String
from std_srvs.srv import Trigger

from path_follower.path import Pose2
from path_follower.path_files import write_course
from path_follower.routes.constants import TICK
from path_follower.routes.mission import FollowerView, Goal, Mission, MissionState, Outcome, Request
from path_follower.routes.network_file import network_path, read_network, to_geojson
from path_follower.routes.params import RouteNavigatorParams
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.constants import HEALTH_PERIOD
from sphere_nav.ros.conversions import driving, header
from sphere_nav.ros.conversions.status import told
from sphere_nav.ros.endpoints import GoalCalls
from sphere_nav.ros.node import OK, WARN, ManagedNode
from sphere_nav.ros.rclpy_shell import ActionGoal
from sphere_nav.ros.run import run
from sphere_nav.ros.service import one_line

try:
    from nav2_msgs.action import NavigateToPose
except ImportError:  # not among the wheels, but where Nav2 is
    NavigateToPose = None

FOLLOWER = "path_follower"
STANDING = (MissionState.HELD, MissionState.WAITING)
NAV2_FAILED = 9001  # error_code of NavigateToPose; 9000 to 9099 are the navigator's


class RouteNavigator(ManagedNode):
    """Converts, asks the mission, converts back."""

    NAME = "route_navigator"
    PARAMS = RouteNavigatorParams
    LARGE_MESSAGES = True
    params: RouteNavigatorParams

    def configure(self) -> None:
        """Read the network; open topics, services and actions."""
        p = self.params
        if not p.network:
            raise ValueError(
                "network: expected a map with routes, or a .geojson file, found none: sphere_nav route build"
            )
        self.network = read_network(network_path(Path(p.network)))
        self.mission = Mission(self.network, p.mission, p.vehicle)
        self.folder = TemporaryDirectory(prefix="route_navigator_")  # of the way that is handed over
        self.goal: tuple[ActionGoal, Any] | None = None  # that of the mission, and what makes its result
        self.said: tuple[Any, ...] = ()
        self.said_at, self.result = -1e9, ""
        self.shown = self.add_publisher("~/network", String, qos.LATCHED)
        self.status = self.add_publisher("~/status", NavigatorStatus, qos.LATCHED)
        self.add_subscription("pose", PoseWithCovarianceStamped, self.on_pose, qos.STATE)
        self.add_subscription("status", LocalizationStatus, self.on_localizer, qos.STATE)
        self.add_subscription(f"{FOLLOWER}/status", FollowerStatus, self.on_follower, qos.STATE)
        self.follower = self.endpoints.add_client(f"{FOLLOWER}/drive", Drive)
        for name in ("pause", "resume"):
            self.add_service(f"~/{name}", Trigger, partial(self.on_call, name))
        self.add_service("~/close_edge", CloseEdge, self.on_close)
        self.add_service("~/plan", PlanRoute, self.on_plan)
        offers = [("navigate", Navigate, self._goal, self._result)]
        if NavigateToPose is not None:
            offers.append(("navigate_to_pose", NavigateToPose, self._nav2_goal, self._nav2_result))
        for name, kind, read, result in offers:
            check, begin = partial(self.check_goal, read), partial(self.begin_goal, read, result)
            self.endpoints.add_action(name, kind, GoalCalls(check, begin, self.cancel_goal))
        self.add_timer(TICK, self.on_tick)

    def activate(self) -> None:
        """Show the network."""
        self.shown.publish(String(data=to_geojson(self.network, is_dense=False)))
        self.tell()

    def cleanup(self) -> None:
        """Remove what was handed over."""
        self.folder.cleanup()

    def now(self) -> float:
        """Return seconds of a clock that no stamp moves."""
        return self.own_ns() / 1e9

    # --- what comes in
    def on_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Take a pose."""
        T_map_base, _ = conversions.pose_with_covariance_to_se3(message, self.params.map_frame)
        self.mission.see_pose(Pose2.of(T_map_base), self.now())

    def on_localizer(self, message: LocalizationStatus) -> None:
        """Take the state of the localiser; in another map than that of the network it is as good as none."""
        ours, theirs = self.network.map_id, message.map_id
        is_other = bool(ours and theirs and ours != theirs)
        self.mission.see_localizer(
            f"in map {theirs}, the network is of {ours}" if is_other else message.state, self.now()
        )

    def on_follower(self, message: FollowerStatus) -> None:
        """Take what the follower says."""
        _, (progress, left) = driving.message_to_progress(message)
        text = message.state, message.permission, message.reason, message.remedy
        view = FollowerView(*text, progress, left, self.now())
        self.mission.see_follower(view)

    def on_call(self, name: str, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Pause or resume."""
        response.message = getattr(self.mission, name)(self.now())
        response.success = not response.message
        if name == "pause":
            self.go_on()
        return response

    def on_close(self, request: CloseEdge.Request, response: CloseEdge.Response) -> CloseEdge.Response:
        """Close or open an edge."""
        self.mission.close(request.edge, request.closed, self.now())
        response.success = True
        response.message = f"edge {request.edge} is {'closed' if request.closed else 'open'}"
        return response

    def on_plan(self, request: PlanRoute.Request, response: PlanRoute.Response) -> PlanRoute.Response:
        """Tell the way to a place."""
        mission = self.mission
        starts = mission.spots_of(Goal(request.start)) if request.start else mission.here()
        route = mission.way(starts, Goal(request.place), 0, self.now())
        response.success, response.edges = True, [leg.name for leg in route.legs]
        response.length, response.duration = route.length, route.seconds
        return response

    # --- goals
    def check_goal(self, read: Any, request: Any) -> None:
        """Raise ValueError for a goal that is not on the network, or that nobody could stop."""
        self.mission.check(read(request), self.now())

    def begin_goal(self, read: Any, result: Any, goal: ActionGoal) -> None:
        """Drive to a goal; the one under way is aborted: this one replaces it."""
        driven = self.mission.driven + self.mission.progress
        self.finish_goal(Outcome(False, "replaced by a new goal", driven))
        self.mission.begin(read(goal.request), self.now())
        self.goal = goal, result
        self.tell()

    def cancel_goal(self, goal: ActionGoal) -> None:
        """Stop, then end."""
        if self.goal is not None and self.goal[0] is goal:
            self.mission.cancel("canceled", self.now())
            self.go_on()

    def _goal(self, request: Navigate.Goal) -> Goal:
        pose = None if request.place else self._pose(request.pose)
        return Goal(request.place, pose, int(request.laps))

    def _pose(self, message: PoseStamped) -> Pose2:
        driving.check_frames(message, self.params.map_frame)
        return Pose2.of(conversions.pose_to_se3(message.pose))

    def _result(self, outcome: Outcome) -> Navigate.Result:
        return told(Navigate.Result(), outcome)

    def _nav2_goal(self, request: Any) -> Goal:
        return Goal("", self._pose(request.pose))

    def _nav2_result(self, outcome: Outcome) -> Any:
        result = NavigateToPose.Result(error_code=0 if outcome.success else NAV2_FAILED)
        if hasattr(result, "error_msg"):  # since Kilted
            result.error_msg = outcome.reason
        return result

    def finish_goal(self, outcome: Outcome) -> None:
        """End the goal of the mission."""
        if self.goal is not None:
            goal, result = self.goal
            self.goal = None
            goal.finish(result(outcome), success=outcome.success)

    # --- what goes out
    def on_tick(self) -> None:
        """Ask the mission what to do, and tell how it goes."""
        mission = self.mission
        self.go_on()
        outcome, mission.outcome = mission.outcome, None
        if outcome is not None:
            self.result = outcome.reason
            (self.log.info if outcome.success else self.log.warning)(f"mission: {outcome.reason or 'arrived'}")
            self.finish_goal(outcome)
        if self.goal is not None and self.goal[1] == self._result:
            self.goal[0].publish(told(Navigate.Feedback(), mission))
        self.tell()

    def go_on(self) -> None:
        """Ask the follower for what is due."""
        request = self.mission.tick(self.now())
        if request is not None:
            self.ask(request)

    def ask(self, request: Request) -> None:
        """Ask the follower; its answer comes when it comes."""

        def answer(response: Any, failure: str) -> None:
            refusal = failure or ("" if response.success else response.message or "refused")
            self.mission.answer(request, refusal, 0 if failure else response.permission, self.now())

        path = ""
        if request.points is not None:
            file = Path(self.folder.name) / "course.csv"
            try:
                write_course(file, request.points, self.network.map_id)
            except OSError as error:
                answer(None, one_line(error))
                return
            path = str(file)
        self.follower(Drive.Request(request=request.name, permission=request.permission, path=path), answer)

    def tell(self) -> None:
        """Publish the status, on every change and once a second."""
        mission, now = self.mission, self.now()
        closed = [str(edge) for edge in sorted(mission.closed_now(now))]
        news = mission.state, mission.reason, mission.goal, mission.edge, mission.next_place, closed
        if news == self.said and now - self.said_at < HEALTH_PERIOD:
            return
        text, is_standing = f"{mission.state} {mission.reason}", mission.state in STANDING
        self.endpoints.tell("mission", WARN if is_standing and mission.reason else OK, text.strip(), text)
        self.said, self.said_at = news, now
        status = NavigatorStatus(header=header(self.now_ns(), self.params.map_frame), map_id=self.network.map_id)
        status.closed_edges, status.last_result = closed, self.result
        self.status.publish(told(status, mission))


def main() -> int:
    """Run the node."""
    return run(RouteNavigator)
