"""What a mission asks of the follower, and when: one request at a time, and motion only where it may be."""

import pytest

from path_follower.arming import OPERATOR, Arming
from path_follower.modes import WITHDRAWN, Event, Mode
from path_follower.params import VehicleParams
from path_follower.path import Pose2
from path_follower.reasons import StopReason
from path_follower.routes.constants import MAX_SILENCE
from path_follower.routes.mission import TABLE, FollowerView, Goal, Mission, MissionState
from path_follower.routes.network import Spot
from path_follower.routes.params import MissionParams
from sphere_nav.localization.status import Verdict

CALL_PATIENCE, RETRY, STEADY, TICK = 5.0, 3.0, 1.0, 0.2

PARAMS = MissionParams(patience=5.0)
GOAL = Goal("end")
EVENTS = {name: Event[name.upper()] for name in ("load", "clear", "start", "stop", "pause", "resume")}


class Trip:
    """A mission, and a follower's own table of states that does at once what it is asked for, and brakes at once."""

    def __init__(self, network):
        self.mission = Mission(network, PARAMS, VehicleParams())
        self.mode = Mode()
        self.now, self.asked = 0.0, []
        self.progress, self.length = 0.0, 0.0
        self.localizer, self.pose, self.is_answering, self.refusal = "TRACKING", Pose2(1.0, 0.1, 0.0), True, ""
        self.silent = ""  # who says nothing
        self.follow()

    @property
    def state(self):
        return self.mode.state

    def follow(self):
        mode = self.mode
        words = mode.state, mode.permission, mode.verdict.reason, "call start"
        way = self.progress, self.length - self.progress
        self.mission.see_follower(FollowerView(*words, *way, self.now))

    def live(self, seconds=TICK):
        """Let time pass; return the requests of it."""
        before = len(self.asked)
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            self.mode.settle(is_standing=not self.mode.is_driving)
            if self.silent != "pose":
                self.mission.see_pose(self.pose, self.now)
            if self.silent != "localizer":
                self.mission.see_localizer(self.localizer, self.now)
            if self.silent != "follower":
                self.follow()
            request = self.mission.tick(self.now)
            if request is not None:
                self.asked.append(request.name)
                if self.is_answering:
                    self.answer(request)
        return self.asked[before:]

    def live_until(self, request):
        while self.asked[-1:] != [request]:
            self.live()

    def answer(self, request):
        def do():
            return self.refusal or self.mode.take(EVENTS[request.name], OPERATOR)

        refusal = Arming.under(self, request.permission, do, is_stop=request.name == "stop")
        if request.name == "load" and not refusal:
            self.length, self.progress = request.route.length, 0.0
        if request.name == "clear" and not refusal:
            self.length = self.progress = 0.0
        self.mission.answer(request, refusal, self.mode.permission, self.now)

    def drive_off(self, goal=GOAL):
        self.mission.begin(goal, self.now)
        asked = self.live(3 * STEADY)
        assert asked[-2:] == ["load", "start"]
        assert self.mission.state is MissionState.DRIVING
        return self

    def stop(self, reason):
        """Stop by what the follower has found."""
        self.mode.halt(Verdict(StopReason(reason)))
        return self.live(1.0)

    def do(self, name):
        """Let an operator ask the follower itself."""
        assert self.mode.take(EVENTS[name], OPERATOR) == ""
        return self.live(1.0)


@pytest.fixture
def trip(fork):
    return Trip(fork.with_place("end", Spot(max(fork.edges), 40.0)))


def test_only_what_somebody_asks_for_leads_out_of_a_hold_and_nothing_but_a_goal_out_of_idle():
    asked = {"begin", "cancel", "resume", "follower started"}
    for event in TABLE.keys() - asked:
        assert {TABLE[event].get(held, held) for held in ("PAUSED", "HELD")} <= {"PAUSED", "HELD"}
        assert "IDLE" not in TABLE[event]
    ended = TABLE["permission ended"]
    assert set(ended.values()) == {"HELD"}
    assert ended.keys() == set(MissionState) - {"IDLE", "PAUSED", "HELD"}  # all that ask for motion


def test_a_mission_loads_starts_and_arrives(trip):
    trip.drive_off()
    assert trip.asked == ["load", "start"]
    assert trip.mission.distance_remaining == pytest.approx(trip.length)
    trip.progress = 0.5 * trip.length
    trip.live()
    assert trip.mission.distance_remaining == pytest.approx(trip.length / 2, abs=0.1)
    assert trip.mission.time_remaining == pytest.approx(trip.length / 2 / 1.4, rel=0.05)
    trip.progress = trip.length
    trip.mode.take(Event.END)
    assert trip.live(1.0) == []
    outcome = trip.mission.outcome
    assert (outcome.success, outcome.reason, outcome.distance) == (True, "", pytest.approx(trip.length, abs=0.1))
    assert trip.mission.state is MissionState.IDLE


def test_a_mission_waits_for_a_pose_and_for_a_localiser_that_searches(trip):
    trip.silent = "pose"
    trip.mission.begin(GOAL, 0.0)
    assert trip.live(1.0) == []
    assert trip.mission.reason.startswith("no pose")
    trip.silent, trip.localizer = "", "SEARCHING"
    assert trip.live(4.0) == []
    assert trip.mission.reason == "the localiser is SEARCHING: wait for TRACKING, or call its relocalize"
    trip.localizer = "TRACKING"
    assert trip.live(0.5 * STEADY) == []
    assert trip.live(STEADY) == ["load", "start"]


def test_a_goal_that_nobody_could_stop_is_refused(trip):
    """The permission of a follower that says nothing is not known, so a stop of it would not be seen."""
    trip.live(1.0)
    trip.silent = "follower"
    trip.live(MAX_SILENCE + TICK)
    with pytest.raises(ValueError, match="no status of path_follower: see that it runs"):
        trip.mission.begin(GOAL, trip.now)


@pytest.mark.parametrize("reason", ["NOT_LOCALISED", "POSE_TIMEOUT", "LOCALISATION_DEGRADED"])
def test_a_mission_goes_on_when_the_lost_pose_returns(trip, reason):
    trip.drive_off()
    trip.localizer = "LOST"
    assert trip.stop(reason) == []
    assert trip.mission.state is MissionState.WAITING
    trip.localizer = "TRACKING"
    assert trip.live(2 * STEADY) == ["load", "start"]


@pytest.mark.parametrize("reason", ["EMERGENCY_STOP", "POSE_JUMP", "OFF_PATH", "WRONG_MAP", "COMMAND_GUARD"])
def test_a_mission_stopped_by_a_fault_waits_for_resume(trip, reason):
    trip.drive_off()
    assert trip.stop(reason) == []
    assert trip.live(60.0) == []
    assert trip.mission.state is MissionState.HELD
    assert reason in trip.mission.reason
    assert trip.mission.resume(trip.now) == ""
    assert trip.live(2 * STEADY) == ["stop", "load", "start"]


@pytest.mark.parametrize(("beyond", "leg"), [(-0.1, 0), (0.1, 1)])
def test_an_obstacle_closes_the_edge_on_which_it_stands(trip, beyond, leg):
    """0.7 m before the front of a body that ends 1.55 m before the axle whose progress counts."""
    trip.drive_off()
    usual, end = [part.edge for part in trip.mission.route.legs], trip.mission.route.ends[0]
    trip.progress = end - 1.55 - 0.7 + beyond
    for _ in range(6):
        trip.stop("OBSTACLE")
        trip.live(1.0)
    assert trip.mission.closed_now(trip.now) == {usual[leg]}


@pytest.mark.parametrize(("advanced", "is_blocked"), [(0.25, True), (0.35, False)])
def test_an_obstacle_farther_on_is_another_one(trip, advanced, is_blocked):
    trip.drive_off()
    trip.progress = 5.0
    for _ in range(3):
        trip.stop("OBSTACLE")
    trip.progress += advanced
    for _ in range(4):
        trip.stop("OBSTACLE")
    assert bool(trip.mission.closed_now(trip.now)) == is_blocked
    for _ in range(8):
        trip.stop("OBSTACLE")
    assert trip.mission.closed_now(trip.now)


def test_a_smoothed_course_or_another_path_does_not_spoil_the_progress(trip):
    trip.drive_off()
    length = trip.length
    for total, progress in ((0.996 * length - 0.9, 10.0), (1.004 * length + 0.9, 12.0), (1.006 * length + 1.0, 30.0)):
        trip.length, trip.progress = total, progress
        trip.live()
    assert trip.mission.progress == pytest.approx(12.0 * length / (1.004 * length + 0.9))


def test_a_follower_that_does_not_answer_is_told_again_to_stop_for_a_pause(trip):
    trip.drive_off()
    trip.is_answering = False
    assert trip.mission.pause(trip.now) == ""
    asked = trip.live(3 * (CALL_PATIENCE + 1.5))
    assert set(asked) == {"stop"}
    assert len(asked) >= 4


def test_a_vehicle_that_is_there_need_not_drive(trip):
    trip.pose = trip.mission.network.nodes[trip.mission.network.places["end"]]
    trip.mission.begin(GOAL, 0.0)
    assert trip.live(2 * STEADY) == []
    assert (trip.mission.outcome.success, trip.mission.outcome.distance) == (True, pytest.approx(0.0, abs=0.3))


def test_an_obstacle_that_stays_closes_its_edge_and_another_way_is_taken(trip):
    trip.drive_off()
    trip.progress = 13.0  # of 13.9 m to the branch: it stands on the edge behind it
    usual = [leg.edge for leg in trip.mission.route.legs]
    for _ in range(6):
        trip.stop("OBSTACLE")
        trip.live(1.0)
    trip.pose = Pose2(14.0, 0.0, 0.0)
    trip.live(3.0)
    assert trip.mission.closed_now(trip.now) == {usual[1]}
    other = [leg.edge for leg in trip.mission.route.legs]
    assert other[0] == usual[0]
    assert other[1] not in usual
    assert trip.mission.driven == pytest.approx(13.0)
    assert trip.live(PARAMS.memory) == []
    assert trip.mission.closed_now(trip.now + PARAMS.memory) == set()


def test_a_mission_that_begins_before_an_obstacle_takes_another_way_too(trip):
    start = trip.mode.take
    trip.mode.take = lambda event, *by: "OBSTACLE: found 9, limit 3" if event is Event.START else start(event, *by)
    trip.pose = Pose2(13.0, 0.0, 0.0)  # the branch begins at 13.9 m
    trip.mission.begin(GOAL, trip.now)
    asked = trip.live(3 * STEADY)
    usual = [leg.edge for leg in trip.mission.route.legs]
    assert asked == ["load", "start"]
    assert trip.live(PARAMS.patience - 2.0) == ["start"]
    assert trip.mission.closed_now(trip.now) == set()
    trip.live(3.0)
    assert trip.mission.closed_now(trip.now) == {usual[1]}
    del trip.mode.take
    trip.live(2 * RETRY)
    assert trip.mission.state is MissionState.DRIVING
    assert usual[1] not in [leg.edge for leg in trip.mission.route.legs]


def test_an_obstacle_is_forgotten_once_the_mission_has_been_given_up_or_something_else_is_missing(trip):
    trip.drive_off()
    trip.stop("OBSTACLE")
    trip.refusal = "NOT_LOCALISED: wait until the localiser is TRACKING, then call start"
    trip.live(RETRY)
    trip.refusal = ""
    trip.live(RETRY + STEADY)
    trip.live(2 * PARAMS.patience)
    trip.stop("OBSTACLE")
    assert trip.mission.closed_now(trip.now) == set()
    trip.do("stop")
    trip.live(PARAMS.patience)
    assert trip.mission.resume(trip.now) == ""
    assert trip.live(2 * STEADY)[-2:] == ["load", "start"]
    assert trip.mission.closed_now(trip.now) == set()


def test_a_closed_edge_ahead_is_gone_around_and_one_behind_does_not_matter(trip):
    trip.drive_off()
    usual = [leg.edge for leg in trip.mission.route.legs]
    trip.mission.close(str(usual[1]), True, trip.now)
    assert trip.live(2 * STEADY) == ["stop", "load", "start"]
    assert usual[1] not in [leg.edge for leg in trip.mission.route.legs]
    trip.progress = trip.length - 5.0
    trip.live()
    trip.mission.close(str(usual[0]), True, trip.now)
    assert trip.live(1.0) == []
    with pytest.raises(ValueError, match=r"edge: expected one of .*, found 'x'"):
        trip.mission.close("x", True, trip.now)


def test_where_no_way_is_left_the_mission_ends_with_a_name(trip):
    trip.drive_off()
    for edge in set(trip.mission.network.edges) - {trip.mission.route.legs[0].edge}:
        trip.mission.close(str(edge), True, trip.now)
    assert trip.live(2 * STEADY)[0] == "stop"
    assert trip.mission.outcome.reason.startswith("no way: no edges lead there from here while")
    trip.pose = Pose2(1.0, 3.0, 0.0)
    trip.mission.begin(GOAL, trip.now)
    trip.live(2 * STEADY)
    assert trip.mission.outcome.reason.startswith("no way: expected a vehicle within 0.8 m of the network")


def test_a_cancel_while_the_start_is_not_answered_still_stops(trip):
    """The answer comes late: the vehicle drives off, and is stopped."""
    trip.mission.begin(GOAL, trip.now)
    trip.live(STEADY)
    trip.is_answering = False
    while trip.asked[-1:] != ["start"]:
        trip.live()
        if trip.asked[-1:] == ["load"]:
            trip.answer(trip.mission._pending[0])
    late, refusal = trip.mission._pending[0], trip.mission.pause(trip.now)
    trip.mission.cancel("canceled", trip.now)
    assert (trip.live(1.0), refusal) == ([], "path_follower is just being started: pause once more")
    trip.is_answering = True
    trip.answer(late)
    assert trip.live(2.0) == ["stop", "clear"]
    assert (trip.mission.outcome.reason, trip.state) == ("canceled", "NO_PATH")


@pytest.mark.parametrize(
    "refusal", ["NOT_LOCALISED: wait", "SCAN_TIMEOUT: no scan yet", "the vehicle is still braking"]
)
def test_a_start_that_is_refused_for_what_is_missing_is_tried_again(trip, refusal):
    trip.mission.begin(GOAL, trip.now)
    trip.live_until("load")
    trip.refusal = refusal
    trip.live(1.0)
    assert (trip.mission.state, trip.mission.reason) == (MissionState.WAITING, refusal)
    trip.refusal = ""
    assert trip.live(RETRY + 2 * STEADY) == ["load", "start"]


def test_an_emergency_stop_that_is_released_starts_nothing(trip):
    trip.drive_off()
    trip.stop("EMERGENCY_STOP")
    trip.mission.resume(trip.now)
    trip.live_until("load")
    trip.refusal = "EMERGENCY_STOP: release it, then call start"
    trip.live(1.0)
    assert (trip.mission.state, trip.mission.reason) == (
        MissionState.HELD,
        "EMERGENCY_STOP: release it, then call resume",
    )
    trip.refusal = ""
    assert trip.live(60.0) == []
    trip.mission.resume(trip.now)
    assert trip.live(2 * STEADY) == ["stop", "load", "start"]


@pytest.mark.parametrize("request_", ["stop", "pause", "load"])
@pytest.mark.parametrize("seconds", [0.0, 0.4, 1.2, 1.4, 3.0])
def test_a_mission_whose_vehicle_somebody_else_has_stopped_is_held_whatever_it_was_doing(trip, request_, seconds):
    """Before the way is planned, before and after it is loaded, and while it is driven."""
    trip.mode.take(Event.LOAD)
    trip.live(1.0)
    trip.mission.begin(GOAL, trip.now)
    trip.live(seconds)
    if request_ == "load" and trip.mode.is_driving:
        trip.do("stop")
    refusal = trip.mode.take(EVENTS[request_], OPERATOR)
    trip.live(30.0)
    if refusal:  # nothing to pause
        assert "nothing to pause" in refusal
        return
    assert not trip.mode.is_driving
    assert trip.mission.state is MissionState.HELD
    assert trip.mission.resume(trip.now) == ""
    trip.live(3 * STEADY)
    assert trip.mode.is_driving


def test_a_request_that_was_decided_before_a_stop_is_refused(trip):
    """It is under way while the vehicle is stopped."""
    trip.mission.begin(GOAL, trip.now)
    trip.live_until("load")
    trip.is_answering = False
    assert trip.live() == ["start"]
    late = trip.mission._pending[0]
    trip.do("stop")
    trip.is_answering = True
    trip.answer(late)
    assert not trip.mode.is_driving
    assert (trip.mission.state, trip.mission.reason) == (MissionState.HELD, f"{WITHDRAWN}: then call resume")
    assert trip.live(60.0) == []


def test_a_mission_that_ends_early_leaves_nothing_that_a_start_would_drive(trip):
    trip.drive_off()
    trip.do("stop")
    trip.mission.cancel("canceled", trip.now)
    trip.live(1.0)
    assert (trip.mission.outcome.reason, trip.state) == ("canceled", "NO_PATH")
    trip.drive_off()
    trip.do("stop")
    trip.do("load")
    trip.length = 12.0
    trip.mission.cancel("canceled", trip.now)
    trip.live(1.0)
    assert trip.state == "IDLE"  # the path that somebody has loaded since is theirs


def test_a_goal_that_comes_while_the_way_to_the_last_one_is_cleared_away_is_driven_to(trip):
    trip.drive_off()
    trip.mission.cancel("canceled", trip.now)
    assert trip.live() == ["stop"]
    trip.is_answering = False
    assert trip.live(1.0) == ["clear"]
    late = trip.mission._pending[0]
    trip.mission.begin(GOAL, trip.now)
    trip.is_answering = True
    trip.answer(late)
    assert trip.live(3 * STEADY) == ["stop", "load", "start"]
    assert (trip.mission.state, trip.mission.outcome) == (MissionState.DRIVING, None)


@pytest.mark.parametrize("hold", ["stop", "pause"])
def test_who_starts_the_follower_again_goes_on_with_the_mission(trip, hold):
    trip.drive_off()
    trip.do(hold)
    assert trip.mission.state is MissionState.HELD
    trip.do("start" if hold == "stop" else "resume")
    assert trip.mission.state is MissionState.DRIVING
    trip.mission.pause(trip.now)
    trip.live(1.0)
    trip.do("start")
    assert trip.mission.state is MissionState.DRIVING


def test_a_pause_holds_a_vehicle_that_waits(trip):
    """Whose follower would go on by itself when the pose is back."""
    trip.drive_off()
    trip.stop("POSE_TIMEOUT")
    assert trip.mission.pause(trip.now) == ""
    assert (trip.live(1.0), trip.state) == (["stop"], "STOPPED")


def test_pause_and_resume(trip):
    assert trip.mission.pause(trip.now) == "nothing to pause: IDLE"
    assert trip.mission.resume(trip.now) == "nothing to resume: IDLE"
    trip.drive_off()
    assert trip.mission.pause(trip.now) == ""
    assert trip.live(1.0) == ["stop"]
    assert (trip.state, trip.mission.state) == ("STOPPED", MissionState.PAUSED)
    assert trip.live(60.0) == []
    assert trip.mission.resume(trip.now) == ""
    assert trip.live(2 * STEADY) == ["stop", "load", "start"]
    assert trip.mission.state is MissionState.DRIVING
    trip.silent = "follower"
    assert trip.live(MAX_SILENCE + 5 * TICK) == []
    assert trip.mission.state is MissionState.HELD
    assert trip.mission.resume(trip.now) == "no status of path_follower: see that it runs"


def test_rounds_that_are_left_after_a_stop(ring):
    trip = Trip(ring.with_place("end", Spot(max(ring.edges), 40.0)))
    trip.drive_off(Goal("end", laps=3))
    around = sum(edge.length for edge in trip.mission.network.edges.values())
    first = trip.length
    assert first == pytest.approx(39.0 + 3 * around, abs=0.5)
    trip.progress = 39.0 + 1.5 * around
    trip.live()
    trip.pose = trip.mission.network.edges[max(ring.edges)].curve.pose(5.0)
    trip.mission.pause(trip.now)
    trip.live()
    trip.do("stop")
    trip.mission.resume(trip.now)
    trip.live(3 * STEADY)
    assert trip.mission.laps_remaining == 1
    assert trip.length == pytest.approx(35.0 + around, abs=0.5)
