import threading
import time
from dataclasses import replace

from cycab_sim.params import ClockParams
from cycab_sim.runner import LockStep, Runner
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


SECOND = 1_000_000_000
GO = VehicleCommand(1.0, 0.1)


def test_time_stands_until_the_command_that_answers_the_image():
    lock_step = LockStep(ClockParams(max_wait=30.0))
    lock_step.offer(GO, 1 * SECOND, 1 * SECOND)
    done = threading.Event()
    waiting = threading.Thread(target=lambda: (lock_step.wait(2 * SECOND), done.set()))
    waiting.start()
    lock_step.offer(GO, 2 * SECOND - 1, 2 * SECOND)  # answers an earlier image
    assert not done.wait(0.05)
    lock_step.offer(VehicleCommand(2.0), 2 * SECOND, 2 * SECOND)
    assert done.wait(10.0)
    waiting.join()
    assert lock_step.command(2 * SECOND) == VehicleCommand(2.0)


def test_a_command_that_does_not_come_is_counted_and_the_car_stops():
    lock_step = LockStep(ClockParams(max_wait=0.02))
    lock_step.offer(GO, 1 * SECOND, 1 * SECOND)
    assert not lock_step.wait(2 * SECOND)
    assert lock_step.num_missed == 1
    assert lock_step.wait(3 * SECOND)  # it does not wait again until a command comes
    assert lock_step.command(int(1.25 * SECOND)) == GO
    assert lock_step.command(int(1.26 * SECOND)) == VehicleCommand()
    lock_step.offer(GO, 3 * SECOND, 3 * SECOND)
    assert lock_step.is_engaged


def test_an_older_command_does_not_replace_a_newer_one():
    lock_step = LockStep(ClockParams())
    lock_step.offer(GO, 3 * SECOND, 3 * SECOND)
    lock_step.offer(VehicleCommand(9.0), 2 * SECOND, 3 * SECOND)
    assert lock_step.command(3 * SECOND) == GO


def test_release_ends_a_wait():
    lock_step = LockStep(ClockParams(max_wait=30.0))
    lock_step.offer(GO, 1 * SECOND, 1 * SECOND)
    timer = threading.Timer(0.02, lock_step.release)
    timer.start()
    begin = time.monotonic()
    lock_step.wait(2 * SECOND)
    assert time.monotonic() - begin < 10.0


def test_a_command_ages_by_its_arrival_whatever_is_stamped_on_it():
    for stamp in [0, SECOND // 2, int(1.9 * SECOND)]:
        lock_step = LockStep(ClockParams(max_wait=0.0))
        lock_step.offer(GO, stamp, SECOND)
        assert lock_step.command(int(1.25 * SECOND)) == GO
        assert lock_step.command(int(1.26 * SECOND)) == VehicleCommand()


def test_a_slow_camera_holds_its_command_while_its_images_set_the_pace():
    lock_step = LockStep(ClockParams(max_wait=0.02), camera_period=0.5)
    lock_step.offer(GO, SECOND, SECOND)
    assert lock_step.command(int(1.5 * SECOND)) == GO
    assert lock_step.command(int(1.8 * SECOND)) == VehicleCommand()
    lock_step.wait(int(1.5 * SECOND))  # in vain: nobody answers any more
    assert lock_step.command(int(1.5 * SECOND)) == VehicleCommand()


# --- strict: answers alone, however long they take
def test_the_first_answer_to_an_image_is_obeyed_from_its_instant_on_and_nothing_else():
    lock_step = LockStep(ClockParams(is_strict=True), camera_period=0.2)
    assert not lock_step.take_answer(SECOND, 0.0)
    lock_step.offer(GO, SECOND, SECOND)
    lock_step.offer(VehicleCommand(9.0), SECOND, SECOND)  # a second one, when it happens to come
    assert lock_step.command(SECOND) == VehicleCommand()  # not before it is due
    assert lock_step.take_answer(SECOND, 0.0)
    lock_step.offer(VehicleCommand(7.0), SECOND, SECOND)
    lock_step.offer(VehicleCommand(8.0), SECOND + SECOND // 10, SECOND + SECOND // 10)  # answers no image
    assert lock_step.command(int(1.29 * SECOND)) == GO
    assert lock_step.command(int(1.31 * SECOND)) == VehicleCommand()  # the images stay away: the car brakes
    assert not lock_step.take_answer(int(1.2 * SECOND), 0.0)
