import threading
import time

from cycab_sim.params import ClockParams
from cycab_sim.runner import LockStep
from cycab_sim.vehicle import VehicleCommand

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
