"""A node as a process: init, spin, and an orderly end on SIGINT or SIGTERM within its patience, exit status 0.

Where work is left unfinished (a bag without its end) that is one line, and the exit status is 1. A process gives memory
back to the system (glibc; with other C libraries nothing happens), and its threads take short turns.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from sphere_nav.params import to_yaml
from sphere_nav.params.homes import user_folder
from sphere_nav.ros.executor import GuardedExecutor
from sphere_nav.ros.live import LiveShell, ShellParams
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.service import one_line
from sphere_nav.ros.shared_files import share_file

PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # Fast DDS 2.14 reads this one only
TURN_S = 5e-4  # after which a thread lets another one run that waits; 10 times that by itself
LARGE = 1 << 20  # bytes: planes of key spheres, not what an image of a camera needs
SPARE = 1 << 25  # bytes that stay for the next image


def run(
    node_class: type[ManagedNode],
    args: Sequence[str] | None = None,
    *,
    values: Mapping[str, Any] | None = None,
) -> int:
    """Run one node until it is told to stop; return 0, or 2 if it could not start (one line says why).

    `values` are parameters by dotted name that go before those of the command line.
    """
    words = sys.argv[1:] if args is None else args
    if "--help" in words or "-h" in words:
        sys.stdout.write(help_text(node_class))
        return 0
    return_large_blocks()
    sys.setswitchinterval(TURN_S)  # what works in the background holds up an image for a moment only
    if node_class.LARGE_MESSAGES:
        use_large_segment()
    overrides = [Parameter(name, value=value) for name, value in (values or {}).items()]
    shells: list[LiveShell] = []  # none before it is made

    def unfinished() -> str:
        return "".join(shell.node.unfinished() for shell in shells)

    with until_signal(node_class.PATIENCE, unfinished) as stopped:

        def serve() -> int:
            try:
                shells.append(LiveShell(node_class, words, parameter_overrides=overrides))
            except ValueError as error:
                sys.stderr.write(f"{node_class.NAME}: {error}\n")
                return 2
            return _spin(shells[0], stopped) or int(bool(unfinished()))

        return in_context(node_class.NAME, args, serve)


def in_context(name: str, args: Sequence[str] | None, serve: Callable[[], int]) -> int:
    """Return the exit status of `serve` between rclpy's begin and end, or 2 with one line where it cannot begin."""
    user_folder(".ros/log", "ROS_LOG_DIR", "ROS_HOME")  # else rclpy cannot begin
    try:
        rclpy.init(args=None if args is None else list(args), signal_handler_options=SignalHandlerOptions.NO)
        return serve()
    except ExternalShutdownException:
        return 0
    except rclpy_implementation.RCLError as error:  # of the command line, or of the middleware: security, domain
        sys.stderr.write(f"{name}: cannot start: {one_line(error)}\n")
        return 2
    finally:
        rclpy.try_shutdown()


def help_text(node_class: type[ManagedNode]) -> str:
    """Return what a node says of itself: its purpose, its command line, its parameters."""
    usage = f"usage: {node_class.NAME} [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] [--params-file FILE] ...]"
    purpose = sys.modules[node_class.__module__].__doc__ or ""
    parameters = to_yaml(ShellParams, node_class.PARAMS)
    return f"{usage}\n\n{purpose.strip()}\n\nIts parameters, as --params-file takes them:\n\n{parameters}"


def use_large_segment() -> None:
    """Give this process a shared-memory segment that holds its largest messages, unless the user chose a profile."""
    with suppress(ValueError):
        os.environ.setdefault(PROFILES_VARIABLE, str(share_file("config/fastdds_large.xml")))


@contextmanager
def until_signal(patience: float, unfinished: Callable[[], str]) -> Iterator[Future]:
    """Yield a future that SIGINT or SIGTERM completes, also while the main thread is busy in a long call.

    The bytes that the interpreter writes on a signal are read by a thread, which wakes the executor; if the process
    is then still busy after `patience` seconds it ends at once, with status 1 where `unfinished()` has a line to say.
    """
    stopped: Future = Future()
    inner, outer = socket.socketpair()
    outer.setblocking(False)
    previous = {number: signal.signal(number, lambda *_: None) for number in (signal.SIGINT, signal.SIGTERM)}
    previous_fd = signal.set_wakeup_fd(outer.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(inner, stopped, patience, unfinished), daemon=True).start()
    try:
        yield stopped
    finally:
        signal.set_wakeup_fd(previous_fd)
        for number, handler in previous.items():
            signal.signal(number, handler)
        outer.close()


def _spin(shell: LiveShell, stopped: Future) -> int:
    shell.finish = lambda status: None if stopped.done() else stopped.set_result(status)
    executor = GuardedExecutor(shell.failures)
    executor.add_node(shell)
    try:
        return executor.spin_until(stopped) if shell.start() else 2
    finally:
        shell.failures.guard(shell.stop, "stop")
        executor.shutdown(timeout_sec=0.5)
        shell.destroy_node()


def _watch(wakeups: socket.socket, stopped: Future, patience: float, unfinished: Callable[[], str]) -> None:
    while numbers := wakeups.recv(16):
        if not any(number in (signal.SIGINT, signal.SIGTERM) for number in numbers):
            continue
        if not stopped.done():
            timer = threading.Timer(patience, _end, args=(patience, unfinished))
            timer.daemon = True
            timer.start()
            stopped.set_result(0)


def _end(patience: float, unfinished: Callable[[], str]) -> None:
    line = unfinished()
    if line:
        os.write(2, f"no end {patience:g} s after the signal: {line}\n".encode())
    os._exit(1 if line else 0)


def return_large_blocks() -> None:
    """Have every large array given back when it is freed.

    By itself glibc raises the limit to the largest block freed so far, 32 MB at most, and keeps what is below it:
    pictures that come and go in several threads leave hundreds of megabytes in pieces that fit nothing.
    """
    with suppress(AttributeError, OSError):
        libc: Any = ctypes.CDLL(None)
        libc.mallopt(-3, LARGE)  # M_MMAP_THRESHOLD
        libc.mallopt(-1, SPARE)  # M_TRIM_THRESHOLD
