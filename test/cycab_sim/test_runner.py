import threading
import time
from dataclasses import replace

from cycab_sim.params import ClockParams
from cycab_sim.runner import ANSWER, MEET, PAUSE, LockStep, Runner
from cycab_sim.simulator import START_NS, Simulator
from cycab_sim.vehicle import VehicleCommand


def make(params, clock, hand_out):
    simulator = Simulator(replace(params, clock=clock))
    lock_step = LockStep(clock)
    return Runner(simulator, lock_step, hand_out), simulator, lock_step


def test_commands_that_answer_images_set_the_pace(small_params):
    stamps = []
    done = threading.Event()

    def hand_out(name):
        if name == "camera":  # an answer that comes from another thread, later
            stamps.append(simulator.time_ns)
            if len(stamps) == 8:
                done.set()
            now = simulator.time_ns
            threading.Timer(0.005, lambda: lock_step.offer(VehicleCommand(1.0), now, now)).start()
            return now
        return None

    clock = ClockParams(max_wait=30.0, real_time_factor=1.0)
    runner, simulator, lock_step = make(small_params, clock, hand_out)
    lock_step.offer(VehicleCommand(), START_NS - 1, START_NS)
    runner.start()
    assert done.wait(20.0)
    runner.stop()
    assert stamps == [START_NS + 100_000_000 * i for i in range(8)]
    assert lock_step.num_missed == 0
    assert simulator.vehicle.state.speed > 0.3


def test_without_commands_time_passes_and_the_car_stands(small_params):
    names = []
    runner, simulator, lock_step = make(small_params, ClockParams(real_time_factor=0.0), names.append)
    for _ in range(25):
        runner.turn()
    assert simulator.time_ns == START_NS + 25 * 10_000_000
    assert simulator.vehicle.state.speed == 0.0
    assert names.count("clock") == 13  # 50 a second, with the odometry: every message costs every node that listens
    assert names.count("camera") == 3
    assert names.index("clock") < names.index("camera")  # time first, then what was seen at it
    assert lock_step.num_missed == 0


def test_a_real_time_factor_slows_time_down(small_params):
    ticks = []
    runner, _, _ = make(small_params, ClockParams(real_time_factor=0.5), ticks.append)
    runner.start()
    threading.Event().wait(0.5)
    runner.stop()
    # 0.5 s at half speed: 25 steps, 10 more by the lag that may be caught up; slow machines do fewer
    assert 0 < ticks.count("clock") <= 40


def strict_drive(params, delays, slow=0.0):
    """Drive on answers that come after these times of wall; return where the car was at each image, what was told.

    To tell who is missing takes `slow` s.
    """
    lacks = iter(["a subscription of image_raw", "a publisher of cmd_vel", ""])
    places, told, done = [], [], threading.Event()

    def hand_out(name):
        now = simulator.time_ns
        if name != "camera":
            return None
        places.append((now, simulator.vehicle.state))
        if len(places) > len(delays):
            done.set()
            return None
        answer = VehicleCommand(1.0, 0.1 * len(places))
        threading.Timer(delays[len(places) - 1], lambda: lock_step.offer(answer, now, now)).start()
        return now

    def tell(what):
        told.append((what, simulator.time_ns))
        time.sleep(slow * what.startswith("a "))
        lock_step.offer(VehicleCommand(-1.0), START_NS - 1, START_NS)  # as a follower does by itself
        if what == PAUSE:
            runner.resumed.set()

    simulator = Simulator(replace(params, clock=ClockParams(is_strict=True, max_wait=0.02, pause_at=1.3)))
    lock_step = LockStep(simulator.params.clock, simulator.params.camera.period)
    runner = Runner(simulator, lock_step, hand_out, lambda: next(lacks, ""), tell)
    runner.start()
    assert done.wait(30.0)
    runner.stop()
    return places[: len(delays) + 1], told


def test_where_it_is_strict_the_drive_is_the_same_however_long_answers_take(small_params, monkeypatch):
    monkeypatch.setattr("cycab_sim.runner.SETTLE", 0.15)
    prompt, told = strict_drive(small_params, [0.0] * 8)
    late, told_late = strict_drive(small_params, [0.0, 0.35, 0.0, 0.0, 0.15, 0.0, 0.01, 0.0], slow=0.2)
    assert prompt == late
    assert [what for what, _ in told_late][:3] == [what for what, _ in told][:3]
    assert prompt[-1][1].speed > 0.3
    assert [what for what, _ in told][:3] == ["a subscription of image_raw", "a publisher of cmd_vel", MEET]
    assert {now for what, now in told if what == PAUSE} == {1_300_000_000}
    assert [now for what, now in told_late if what == ANSWER][:2] == [1_100_000_000] * 2
