"""Limits of waiting in seconds of a machine that is free: a process that waits for a processor has not been slow."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

LOOK_S = 0.25  # between two looks at what ran
LEAST = 0.03  # share of the time that counts at least: what waits for ever ends


def family(pid: int) -> Iterator[int]:
    """Yield the ids of a process and of all that it has started."""
    yield pid
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            for child in (thread / "children").read_text(encoding="ascii").split():
                yield from family(int(child))


def ran_and_waited() -> dict[Path, tuple[int, int]]:
    """Return for how long each thread of this process and its children ran, and waited for a processor, ns."""
    found = {}
    for pid in family(os.getpid()):
        with suppress(OSError):
            for thread in Path(f"/proc/{pid}/task").iterdir():
                ran, waited, _ = (thread / "schedstat").read_text(encoding="ascii").split()
                found[thread] = int(ran), int(waited)
    return found


class Patience:
    """Ends after some seconds, of which those count little in which we wanted to run and others did."""

    def __init__(self, seconds: float) -> None:
        self._left, self._seen, self._when = seconds, ran_and_waited(), time.monotonic()

    def is_left(self) -> bool:
        """Whether to wait on."""
        passed = time.monotonic() - self._when
        if passed > LOOK_S:
            before, self._seen = self._seen, ran_and_waited()
            self._when += passed
            pairs = [(now, before.get(thread, (0, 0))) for thread, now in self._seen.items()]
            ran, waited = (sum(now[k] - then[k] for now, then in pairs) / 1e9 for k in range(2))
            self._left -= passed * max(1.0 - waited / max(ran + waited, passed), LEAST)
        return self._left > 0.0


def wait_until(is_done: Callable[[], object], seconds: float = 30.0, turn: Callable[[], object] | None = None) -> bool:
    """Wait until something is done, with a `turn` between two looks; whether it was."""
    patience = Patience(seconds)
    while not is_done():
        if not patience.is_left():
            return False
        turn() if turn else time.sleep(0.05)
    return True
