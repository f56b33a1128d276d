import threading
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
