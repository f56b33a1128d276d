"""The loop of a process. What a callback raises is counted and reported, and the process goes on.

That holds for every callback: subscriptions, timers and services of a node, and those that rclpy makes by itself
(parameters, /clock, lifecycle, logger). Any rclpy node may be added:

    executor = GuardedExecutor(CallbackFailures(log))
    executor.add_node(node)
    executor.spin_until(stopped)                    # an rclpy Future
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.task import Future

from sphere_nav.ros.constants import LOG_PERIOD_S, MAX_WAITS, PAUSE_S, RECENT_S
from sphere_nav.ros.endpoints import ERROR, OK, Entry, ThrottledLog
from sphere_nav.ros.service import one_line


class CallbackFailures:
    """What callbacks raised: counted, a line each in the log, its traceback once, and an entry for the diagnostics."""

    def __init__(self, log: ThrottledLog, clock: Callable[[], float] = time.monotonic) -> None:
        self._log, self._clock = log, clock
        self.num_failed = 0
        self.last_failure = ""
        self._last_s = 0.0  # when the last one was
        self._traced: set[str] = set()

    def add(self, error: BaseException, where: str) -> None:
        """Count what a callback raised."""
        frames = traceback.extract_tb(error.__traceback__)
        place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "nowhere"
        self.num_failed += 1
        self._last_s = self._clock()
        self.last_failure = f"{where}: {one_line(error)} ({place})"
        kind = f"{type(error).__name__} {where} {place}"
        if kind not in self._traced:
            self._traced.add(kind)
            self._log.error("".join(traceback.format_exception(error)).rstrip())
        self._log.error(f"callback failed: {self.last_failure}", every=LOG_PERIOD_S, key=f"callback {kind}")

    def guard(self, step: Callable[[], object], where: str) -> None:
        """Carry out a part of a callback; the parts after it go on, whatever it raises."""
        try:
            step()
        except Exception as error:
            self.add(error, where)

    def examine(self) -> Entry:
        """Return level, line and count for the diagnostics; ERROR for a while after each failure."""
        is_recent = self.num_failed > 0 and self._clock() - self._last_s < RECENT_S
        level, text = (ERROR, self.last_failure) if is_recent else (OK, "all callbacks succeed")
        return level, text, {"failed": self.num_failed, "last": self.last_failure}


class GuardedExecutor(SingleThreadedExecutor):
    """Calls one callback after the other, in the thread that spins; none of them ends the process."""

    def __init__(self, failures: CallbackFailures, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        self.failures = failures
        self._num_failed_waits = 0

    def spin_until(self, stopped: Future) -> int:
        """Serve until the future is done, by whatever thread, or until nothing can be served any more.

        That is when the context was shut down, or waiting fails again and again. Return the exit status: the future's
        result, 0 for a context that was shut down, else 1. rclpy's `spin_until_future_complete` is not used: it adds a
        callback to the future at each wake and never removes one.
        """

        def wake(done: Future) -> None:
            self.create_task(lambda: None)  # a bare wake-up does not end the wait of `spin_once`

        stopped.add_done_callback(wake)
        try:
            while not stopped.done() and self.context.ok() and self._num_failed_waits < MAX_WAITS:
                self.spin_once()
        except ExternalShutdownException:
            pass
        finally:
            stopped.remove_done_callback(wake)
        is_over = stopped.done() or not self.context.ok()
        return int(stopped.result() or 0) if is_over else 1

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback and call it."""
        entity: Any
        try:
            handler, entity, _ = self.wait_for_ready_callbacks(timeout_sec)
        except (ShutdownException, TimeoutException):
            return
        except ExternalShutdownException:
            raise
        except Exception as error:
            self._num_failed_waits += 1
            self.failures.add(error, "waiting for messages")
            time.sleep(PAUSE_S)
            return
        self._num_failed_waits = 0
        handler()
        raised = handler.exception()
        if raised is not None:
            self._release(entity)
            self.failures.add(raised, entity_name(entity))

    def _release(self, entity: Any) -> None:
        """Have an entity served again: rclpy leaves it and its group busy where its message could not be taken."""
        if entity is None:
            return
        entity._executor_event = False
        group = entity.callback_group
        if getattr(group, "_active_entity", None) is entity:
            group.ending_execution(entity)
        self.wake()


def entity_name(entity: Any) -> str:
    """Return what rclpy called: a topic, a service, or the name of its class."""
    if entity is None:
        return "task"
    name = getattr(entity, "topic_name", "") or getattr(entity, "service_name", "")
    return f"{type(entity).__name__.lower()} {name}".rstrip()
