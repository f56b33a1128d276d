"""The shell of a localiser around one that says what it is told: answers, silence, stamps, poses given, losses."""

from dataclasses import replace

import numpy as np
import pytest
from sphere_nav_msgs.srv import Relocalize

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.localization import FINE, InputCheck, Reason, State
from sphere_nav.localization.params import InputParams, NodeParams
from sphere_nav.localization.status import BaseEstimate, status_of
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_pose_with_covariance, stamp_ns
from sphere_nav.ros.endpoints import ERROR, OK
from sphere_nav.ros.localizer.node import LocalizerNode

NUM_COUNTED, STANDSTILL_S = 20, 1.0  # written out: imported, a change would go unseen

CAMERA = Pinhole(64, 48, 50.0, 50.0, 31.5, 23.5)
SECOND = 10**9
STEP = SECOND // 10
T_MAP_BASE = SE3.from_planar(1.0, 2.0, 0.5)


class Parrot(LocalizerNode):
    """Is always at one place, once it has seen an image that can be used."""

    NAME = "parrot"
    PARAMS = NodeParams

    NO_MAP, has_map, found = "set `map`", True, None

    def configure(self):
        self.check, self.searches, self.state = InputCheck(InputParams()), [], State.SEARCHING
        super().configure()

    @property
    def is_ready(self):
        return self.intake.is_mounted

    def localize(self, picture):
        report = self.check.check(picture.image, picture.camera, picture.stamp_ns)
        if not report.is_good:
            return BaseEstimate(self.refuse(picture.stamp_ns, report.finding))
        self.state = State.TRACKING
        return BaseEstimate(status_of(self.state, picture.stamp_ns, FINE), T_MAP_BASE, 0.01 * np.eye(6))

    def refuse(self, stamp_ns, finding):
        return status_of(self.state, stamp_ns, finding)

    def relocalize(self, given):
        if given is not None and given[0].translation[0] > 50.0:
            raise ValueError("initial pose: expected at most 10 m from the map, found 50 m")
        self.searches.append(given and given[0])
        return self.found

    def silence(self, elapsed_s, finding):
        silence = self.check.find_silence(elapsed_s, finding)
        return status_of(State.LOST, *silence) if silence else None

    def forget(self):
        self.check.reset()
        self.state = State.SEARCHING


class Bench:
    def __init__(self, **values):
        self.bus, self.now = OfflineBus(), 100 * SECOND
        self.node = self.bus.add(Parrot, {"base_frame": ""} | values)
        list(self.bus.advance(self.now))
        self.send("/camera_info", camera_to_info(CAMERA, self.now, "camera"))

    def send(self, topic, message):
        self.bus.publish(topic, message)
        return [record for record in self.bus.settle() if record.topic != topic]

    def wait(self, nanoseconds):
        """Let time pass; return the statuses that were said of themselves."""
        self.now += nanoseconds
        return [record.message for record in self.bus.advance(self.now) if record.topic == "/status"]

    def see(self, stamp=None, frame="camera", seed=None):
        """Show an image a step later; return what was said last, by topic."""
        self.wait(STEP)
        pixels = np.random.default_rng(self.now if seed is None else seed).integers(20, 230, (48, 64)).astype(np.uint8)
        said = self.send("/image_raw", array_to_image(pixels, self.now if stamp is None else stamp, frame, "mono8"))
        return {record.topic: record.message for record in said}


def pose_at(x, stamp=100 * SECOND, frame="map"):
    return se3_to_pose_with_covariance(SE3.from_planar(x, 0.0, 0.0), np.eye(6), stamp, frame)


def test_a_camera_that_never_came_is_told_and_its_first_image_ends_it():
    bench = Bench()
    bench.node.clock_jumped()
    assert bench.wait(SECOND) == []
    said = bench.wait(5 * SECOND)
    assert {(status.state, status.reason) for status in said} == {("NOT_LOCALISED", "TIMEOUT")}
    assert "topic name" in said[0].remedy
    assert stamp_ns(said[0]) <= bench.now - 3 * SECOND
    assert bench.see()["/status"].state == "TRACKING"


def test_every_image_is_answered():
    bench = Bench()
    answer = bench.see()
    assert set(answer) == {"/pose", "/odometry", "/tf", "/status"}
    assert answer["/status"].milliseconds > 0.0
    assert set(bench.see(frame="other")) == {"/status"}


def test_a_map_that_is_missing_is_said_before_a_camera_that_is():
    class Lost(Parrot):
        has_map = False

        def refuse(self, stamp_ns, finding):
            return status_of(State.NO_MAP, stamp_ns, replace(finding, advice=self.NO_MAP))

    bench = Bench()
    bench.node = bench.bus.add(Lost, {"base_frame": ""})
    assert bench.node.outputs.state is State.NO_MAP  # before anything came
    said = [(one.state, one.reason, one.remedy) for one in bench.wait(6 * SECOND) if one.state == "NO_MAP"]
    assert set(said) == {("NO_MAP", "", "set `map`")}
    assert bench.node.lack() == "a map (set `map`)"
    parrot = bench.bus.add(Parrot, {"base_frame": ""})
    assert parrot.lack() == "camera_info, or sphere_info of a panorama"
    bench.send("/camera_info", camera_to_info(CAMERA, bench.now, "camera"))
    assert parrot.lack() == ""


def test_silence_is_told_in_time_and_ends_with_the_next_image():
    bench = Bench()
    bench.see()
    said = bench.wait(SECOND)
    assert {(status.state, status.reason) for status in said} == {("LOST", "TIMEOUT")}
    assert stamp_ns(said[0]) <= bench.now - SECOND + 800_000_000  # half a second and one period of the watch
    assert bench.see()["/status"].state == "TRACKING"


@pytest.mark.parametrize("lead_s", [0.2, 3600.0, None])
def test_no_stamp_of_the_future_or_that_stands_still_is_believed_or_delays_the_loss(lead_s):
    bench, said = Bench(), []
    bench.see()
    first = bench.now
    for _ in range(10):
        answer = bench.see(first if lead_s is None else bench.now + STEP + round(lead_s * SECOND))
        assert set(answer) == {"/status"}
        said.append((answer["/status"].state, answer["/status"].reason))
        assert stamp_ns(answer["/status"]) <= bench.now
    assert said[:4] == [("TRACKING", "BAD_STAMP")] * 4
    assert said[5:] == [("LOST", "BAD_STAMP")] * 5
    assert bench.see()["/status"].state == "TRACKING"  # the present is not shut out


def test_images_that_are_lost_before_they_can_be_answered_are_told():
    bench = Bench()
    (camera,) = bench.node.intake._streams.values()  # what the middleware has lost is told by no message
    for _ in range(NUM_COUNTED):
        camera.images.num_lost += 1
        status = bench.see()["/status"]
    assert (status.state, status.reason, status.value) == ("TRACKING", "OVERRUN", 0.5)
    for _ in range(NUM_COUNTED):
        status = bench.see()["/status"]
    assert status.reason == ""


def test_a_pose_given_before_the_first_image_is_given_again_with_it():
    bench = Bench()
    bench.send("/initialpose", pose_at(3.0))
    bench.see()
    bench.see()
    assert [search.translation[0] for search in bench.node.searches] == [3.0, 3.0]
    bench.send("/initialpose", pose_at(4.0))
    bench.see()
    assert len(bench.node.searches) == 3


def test_a_pose_off_the_map_is_refused_and_so_is_one_of_another_frame():
    bench = Bench()
    bench.send("/initialpose", pose_at(99.0))
    wrong = pose_at(1.0)
    wrong.header.frame_id = "odom"
    bench.send("/initialpose", wrong)
    assert next(item for item in bench.node.inputs if item.topic == "initialpose").num_refused == 2
    assert bench.node.searches == []
    answer = bench.node.endpoints.call("relocalize", Relocalize.Request(has_guess=True, guess=pose_at(99.0)))
    assert (answer.success, "found 50 m" in answer.message) == (False, True)
    for state in (State.SEARCHING, State.PROBATION):
        bench.node.found = BaseEstimate(status_of(state, 5, FINE), T_MAP_BASE, 0.01 * np.eye(6))
        answer = bench.node.endpoints.call("relocalize", Relocalize.Request())
        assert answer.success == (answer.pose.pose.pose.position.x == 1.0) == (state is State.PROBATION)


def test_another_localizer_is_heard_while_there_is_no_pose():
    bench = Bench()
    bench.see(seed=0)
    bench.node.outputs.state = State.SEARCHING
    for seconds in (0.0, 0.5, 1.1):  # once a second
        bench.wait(round(seconds * SECOND) - bench.now + 100 * SECOND + STEP)
        bench.send("/other/pose", pose_at(3.0, bench.now))
    assert len(bench.node.searches) == 2
    bench.send("/other/pose", pose_at(99.0, bench.now + 2 * SECOND))  # of the future
    told = next(item for item in bench.node.inputs if item.topic == "other/pose")
    assert "ahead of the clock" in told.last_refusal
    bench.send("/other/pose", pose_at(3.0, bench.now, "odom"))
    assert "frame_id" in told.last_refusal
    bench.see()
    bench.wait(2 * SECOND)
    bench.node.outputs.state = State.TRACKING
    bench.send("/other/pose", pose_at(3.0, bench.now))
    assert len(bench.node.searches) == 2  # it has a pose of its own


@pytest.mark.parametrize(("x", "expected"), [(2.0, OK), (20.0, ERROR)])
def test_agreement_with_another_localizer_is_reported_and_contradiction_too(x, expected, caplog):
    bench = Bench()
    bench.send("/other/pose", pose_at(x, bench.now + STEP))
    assert "agreement" not in bench.node.reports
    bench.see()
    level, _, values = bench.node.reports["agreement"]
    assert level == expected
    assert values["metres"] == pytest.approx(np.hypot(x - 1.0, 2.0), rel=0.02)  # along the arc
    assert ("contradicts" in caplog.text) == (level == ERROR)


def test_reset_accepts_another_camera_and_a_jump_of_the_clock_another_time():
    bench = Bench()
    bench.see()
    assert bench.see(frame="other")["/status"].reason == "BAD_INFO"
    assert bench.node.endpoints.call("reset").success
    assert bench.node.state is State.SEARCHING
    bench.send("/camera_info", camera_to_info(replace(CAMERA, fx=60.0), bench.now, "other"))
    assert bench.see(frame="other")["/status"].state == "TRACKING"
    bench.node.clock_jumped()
    bench.send("/other/pose", pose_at(9.0, bench.now))
    assert "agreement" not in bench.node.reports  # with a pose of before
    assert {status.state for status in bench.wait(5 * SECOND)} == {"NOT_LOCALISED"}  # none since: it is not lost
    assert bench.see(bench.now - 50 * SECOND, "other")["/status"].reason == Reason.NONE


def test_a_clock_that_stands_is_told_once_nobody_publishes_it_and_the_pose_goes_on_with_it(monkeypatch):
    bench, publishers, steady = Bench(), ["/peer"], [0]
    node = bench.node
    assert bench.see()["/status"].state == "TRACKING"
    monkeypatch.setattr(node, "publishers_of", lambda topic: publishers if topic == "/clock" else [])
    monkeypatch.setattr(node, "steady_ns", lambda: steady[-1])

    def stand(seconds):
        for _ in range(round(10 * seconds)):
            steady.append(steady[-1] + STEP)
            node.on_watch()
        return [record.message for record in bench.bus.settle() if record.topic == "/status"]

    assert stand(3 * STANDSTILL_S) == []  # somebody who waits holds it: nothing is wrong, however long
    assert "held by /peer" in node.reports["/clock"][1]
    publishers.clear()
    told = stand(2 * STANDSTILL_S)[-1]
    assert (told.state, told.reason, stamp_ns(told)) == ("DEGRADED", "TIMEOUT", bench.now)
    assert told.value > told.limit == STANDSTILL_S
    assert "/clock stands still" in told.remedy
    assert "/clock stands still" in node.reports["localisation"][1]
    answer = bench.see()["/status"]
    assert (answer.state, answer.reason) == ("TRACKING", "")
