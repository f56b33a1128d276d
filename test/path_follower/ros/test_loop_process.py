"""Real processes: a loop that gets the signals, and a front that may be busy, or killed."""

import itertools
import os
import signal
from types import SimpleNamespace

import pytest
from nav_msgs.msg import Path
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String

from path_follower.ros.loop_process import PRIORITY, LoopShell
from sphere_nav.ros import qos
from worlds.base import CRUISE, Base, children, is_running, start, straight
from worlds.patience import wait_until

pytestmark = pytest.mark.dds


@pytest.fixture
def follower(tmp_path):
    child = start("path_follower", *straight(tmp_path))
    yield child
    child.kill()
    child.wait()


@pytest.fixture
def base(request):
    base = Base(getattr(request, "param", qos.SENSOR))
    yield base
    base.close()


def policies(pid):
    return {os.sched_getscheduler(int(thread)) for thread in os.listdir(f"/proc/{pid}/task")}


def may_be_real_time():
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def test_a_busy_front_holds_up_neither_commands_nor_the_stop(follower, base):
    """Nor is any thread of the loop, where it may be real time, less than that."""
    paths = base.node.create_publisher(Path, "reference_path", qos.LATCHED)
    base.drive_off()
    (front,) = children(follower.pid)
    assert policies(follower.pid) == {os.SCHED_FIFO if may_be_real_time() else os.SCHED_OTHER}
    assert policies(front) == {os.SCHED_OTHER}
    os.kill(front, signal.SIGSTOP)  # as busy as can be
    paths.publish(Path())
    base.commands.clear()
    base.held_up_s = 0.0
    base.live(1.0)
    times = [when for when, _ in base.commands]
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.5 + base.held_up_s  # 0.1 s on an idle machine
    assert base.speed > 0.9 * CRUISE, base.reason
    base.is_pressed = True
    assert base.live(120.0, lambda: base.speed == 0.0 and base.reason == "EMERGENCY_STOP")
    follower.send_signal(signal.SIGINT)
    assert follower.wait(120.0) == 0


def test_a_front_that_is_killed_leaves_zero_and_ends_the_process(follower, base):
    base.drive_off()
    os.kill(*children(follower.pid), signal.SIGKILL)
    assert base.live(120.0, lambda: base.speed == 0.0)
    assert follower.wait(120.0) == 1


def test_a_loop_that_is_killed_takes_its_front_along(follower):
    assert wait_until(lambda: children(follower.pid), 60.0)
    (front,) = children(follower.pid)
    follower.kill()
    follower.wait()
    assert wait_until(lambda: not is_running(front), 60.0)


@pytest.mark.parametrize("base", [qos.SENSOR, qos.LATCHED], indirect=True, ids=["passing", "latched"])
def test_an_emergency_stop_that_was_pressed_before_a_follower_was_there_refuses_its_start(tmp_path, base, request):
    """What was latched is heard, anything else is missed, and named."""
    is_heard = "latched" in request.node.name
    base.is_pressed = True
    base.speak()
    base.is_button_silent = True
    follower = request.getfixturevalue("follower")
    wanted = "EMERGENCY_STOP: release" if is_heard else "base publishes emergency_stop, but nothing of it was heard"

    def is_refused():
        base.ask()
        return wanted in base.answer

    assert base.live(120.0, is_refused), base.answer
    base.is_button_silent = base.is_pressed = False
    base.drive_off()
    base.is_pressed = True
    assert base.live(120.0, lambda: base.speed == 0.0)
    assert follower.poll() is None


class Words:
    """A loop that hears what is latched."""

    def __init__(self, endpoints, *_):
        self.heard = []
        endpoints.add_subscription("words", String, lambda message: self.heard.append(message.data), qos.LATCHED)


def test_what_was_latched_before_the_loop_was_active_is_heard_then(base):
    """Who latches it says it once."""
    told = {"name": "loop", "namespace": "/", "topics": {}, "overrides": {}, "health_name": "loop", "params": None}
    shell = LoopShell(SimpleNamespace(LOOP_CLASS=Words), None, told)
    base.node.create_publisher(String, "words", qos.LATCHED).publish(String(data="once"))
    executor = SingleThreadedExecutor()
    executor.add_node(shell)
    (words,) = shell.inputs
    assert wait_until(lambda: words.kept, 60.0, lambda: executor.spin_once(timeout_sec=0.05))
    assert shell.loop.heard == []
    shell.ask("activate")
    assert (shell.loop.heard, words.kept) == (["once"], [])
    shell.destroy_node()
