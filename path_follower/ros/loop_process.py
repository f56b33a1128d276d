"""A control loop as a process: the one that is started, and gets the signals; its front is a process beneath it.

The process does nothing but the loop. A signal is answered by the zero command whatever the front is busy with; so is
the end of the front. The loop's node has no services and no parameters of its own, and looks at the size of a message
before it converts it.
"""

from __future__ import annotations

import gc
import os
import queue
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any

from rclpy.executors import Executor
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.task import Future

from path_follower.ros.front import LOOP, FrontNode
from sphere_nav.ros.executor import CallbackFailures, GuardedExecutor
from sphere_nav.ros.interfaces import from_bytes
from sphere_nav.ros.node import ThrottledLog
from sphere_nav.ros.rclpy_shell import RclpyShell
from sphere_nav.ros.run import help_text, in_context, run, until_signal
from sphere_nav.ros.service import one_line
from sphere_nav.ros.subscription import Subscription

MAX_BYTES = 1 << 18  # of a message: a scan of 30,000 beams with intensities
PRIORITY = 10  # real-time (FIFO) priority of the loop, where the user may (limits.conf: rtprio)
NICE = -10  # of the loop otherwise, where the user may (limits.conf: nice); wakes up late on a crowded machine
FRONT_PATIENCE = 1.2  # s for the front to end, after the zero command


def run_with_loop(front_class: type[FrontNode]) -> int:
    """Run a loop and its front until told to stop; return 0, or 2 where the front could not start."""
    words = sys.argv[1:]
    if LOOP in os.environ:
        return run(front_class)
    if "--help" in words or "-h" in words:
        sys.stdout.write(help_text(front_class))
        return 0
    server = LoopServer(front_class, CallbackFailures(ThrottledLog(get_logger(f"{front_class.NAME}_loop"))))
    with until_signal(front_class.PATIENCE, server.unfinished) as stopped, _front(front_class, stopped) as connection:
        return in_context(front_class.NAME, words, lambda: _serve(server, connection, stopped))


@contextmanager
def _front(front_class: type[FrontNode], stopped: Future) -> Iterator[Connection]:
    """Have a front, which ends with this process, and whose end stops this one; yield the connection to it."""
    ours, theirs = socket.socketpair()
    life, watched = os.pipe()  # the front reads what nobody writes
    inherited = theirs.fileno(), life
    code = f"import sys; from {front_class.__module__} import main; sys.exit(main())"
    environment = os.environ | {LOOP: f"{inherited[0]} {inherited[1]}"}
    front = subprocess.Popen([sys.executable, "-P", "-c", code, *sys.argv[1:]], env=environment, pass_fds=inherited)
    theirs.close()
    os.close(life)
    threading.Thread(target=_await_front, args=(front, stopped), daemon=True).start()
    try:
        yield Connection(os.dup(ours.fileno()))
    finally:
        ours.shutdown(socket.SHUT_RDWR)
        os.close(watched)
        with suppress(subprocess.TimeoutExpired):
            front.wait(FRONT_PATIENCE)
        front.kill()


def _serve(server: LoopServer, connection: Connection, stopped: Future) -> int:
    server.executor = executor = GuardedExecutor(server.failures)
    take_precedence()
    threading.Thread(target=_listen, args=(connection, server, executor), daemon=True).start()
    try:
        return executor.spin_until(stopped)
    finally:
        server.failures.guard(server.close, "stop")
        executor.shutdown(timeout_sec=0.2)


def take_precedence(policy: int = os.SCHED_FIFO, priority: int = PRIORITY) -> None:
    """Be served first: all threads, those that wait for a signal or the front's end among them, and what they start."""
    for thread in map(int, os.listdir("/proc/self/task")):
        try:
            os.sched_setscheduler(thread, policy, os.sched_param(priority))
        except PermissionError:
            with suppress(PermissionError):
                os.setpriority(os.PRIO_PROCESS, thread, NICE)


def _listen(connection: Connection, server: LoopServer, executor: Executor) -> None:
    """Have every request of the front carried out between two callbacks, and send the answer."""
    answers: queue.SimpleQueue[tuple[int, bool, Any]] = queue.SimpleQueue()
    with suppress(OSError, EOFError, AttributeError):  # the last: the executor has ended
        while True:
            number, name, values = connection.recv()
            executor.create_task(lambda n=number, r=name, v=values: answers.put((n, *server.answer(r, v))))
            connection.send(answers.get())


def _await_front(front: subprocess.Popen[bytes], stopped: Future) -> None:
    status = front.wait()
    if not stopped.done():
        stopped.set_result(status if status >= 0 else 1)


class LoopServer:
    """Makes the loop's node as the front says, and hands requests on to the loop."""

    executor: Executor

    def __init__(self, front_class: type[FrontNode], failures: CallbackFailures) -> None:
        self._front_class, self.failures = front_class, failures
        self.shell: LoopShell | None = None

    def unfinished(self) -> str:
        """Return what has not been done for an orderly end; empty where all was."""
        return "the last zero command may not have gone out" if self.shell is not None else ""

    def answer(self, name: str, values: Sequence[Any]) -> tuple[bool, Any]:
        """Return whether a request was carried out, and its answer, or in one line why not."""
        try:
            if name == "configure":
                self.close()
                self.shell = LoopShell(self._front_class, self.failures, *values)
                self.executor.add_node(self.shell)
                gc.collect()
                gc.freeze()  # what lives as long as the loop is not looked at again and again
                return True, None
            if name == "cleanup":
                self.close()
                return True, None
            if self.shell is None:
                raise ValueError(f"{name}: expected a loop that is configured, found none")
            return True, self.shell.ask(name, *values)
        except Exception as error:
            return False, one_line(error)

    def close(self) -> None:
        """End with a zero command, if there is a loop."""
        shell = self.shell
        if shell is not None:
            shell.ask("deactivate")
            self.shell = None
            self.executor.remove_node(shell)
            shell.destroy_node()


class LoopShell(RclpyShell):
    """The loop's node: topics with the names that the front has resolved, and timers."""

    callbacks_name = "callbacks of the loop"  # beside those of the front, which has the same name in /diagnostics

    def __init__(self, front_class: type[FrontNode], failures: CallbackFailures, setup: dict[str, Any]) -> None:
        rules = [word for topic, name in setup["topics"].items() for word in ("-r", f"{topic}:={name}")]
        super().__init__(
            setup["name"],
            failures,
            namespace=setup["namespace"],
            cli_args=["--ros-args", *rules],
            use_global_arguments=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter(name, value=value) for name, value in setup["overrides"].items()],
        )
        self.health_name = setup["health_name"]
        self.loop = front_class.LOOP_CLASS(self, setup["params"])

    def ask(self, name: str, *values: Any) -> Any:
        """Carry out a request of the front."""
        if name == "activate":
            self.is_active = True
            self.deliver_kept()
            return None
        if name == "deactivate":
            if self.is_active:
                self.loop.ask("stand")
            self.is_active = False
            return None
        return self.loop.ask(name, *values)

    def clock_jumped(self) -> None:
        """Forget everything with a stamp."""
        self.loop.ask("clock_jumped")

    def listen(self, wanted: Subscription) -> None:
        """Subscribe to bytes; a message is converted if it is of a reasonable size."""
        convert, kind, wanted.raw = wanted.callback, wanted.kind, True
        wanted.callback = lambda data: convert(from_bytes(data, kind, MAX_BYTES))
        super().listen(wanted)
