"""What strangers do to the operator's page: other pages, other names, guesses, noise."""

from __future__ import annotations

import argparse
import os
import re
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path

from benchmarks.commands import COMMAND
from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav_tools.cli.constants import GUESS_S
from sphere_nav_tools.cli.processes import Processes, python_command

TOKEN, FOREIGN = "token_of_the_yard", ("http://evil.example", "http://127.0.0.1:1", "http://localhost:8081", "null")
HOSTS = ("evil.example", "127.0.0.1.evil.example", "10.0.0.1", "0.0.0.0")
KEY = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
UPGRADE = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", KEY)
HEAD = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
HANDSHAKE = HEAD + "\r\n".join([*UPGRADE, "", ""]).encode()
BEGINS = {
    "noise in place of a request": b"",
    "noise as a header": HEAD + b"X: ",
    "noise after a refused handshake": HANDSHAKE,
    "noise as one message after it": HANDSHAKE + b"\x82\xff" + b"\0" * 6,
}
SIZES = {"quick": (1000, 64 << 20), "full": (10_000, 1 << 30)}  # guesses, bytes of noise
PIECE = 1 << 16  # bytes
IN = ("101", "200")  # answers to who is let in
WARM_UP = 200  # requests before memory is looked at: what is taken once


class Victim:
    """The command in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.nodes = Processes(folder)
        words = f"operate --token {TOKEN} --port 8461 --folder".split()
        self.nodes.begin("operate", python_command(COMMAND, *words, str(folder)))
        while not (found := re.search(r":(\d+)/", (folder / "operate.log").read_text(encoding="utf-8"))):
            self.nodes.check()
            time.sleep(0.1)
        self.port = int(found[1])

    def ask(self, path: str = f"/{TOKEN}", host: str = "", *lines: str) -> str:
        """Return the status that a request is answered with; empty: none."""
        head = [f"GET {path} HTTP/1.1", f"Host: {host or '127.0.0.1'}:{self.port}", *lines, "", ""]
        with socket.create_connection(("127.0.0.1", self.port), timeout=10.0) as line, suppress(OSError):
            line.sendall("\r\n".join(head).encode())
            return line.recv(64).decode("latin-1").partition(" ")[2][:3]
        return ""

    def pour(self, count: int, begin: bytes) -> list[str]:
        """Send bytes of noise after a beginning, on as many connections as it takes, read or not: no status."""
        noise, sent = os.urandom(PIECE), 0
        while sent < count:
            with socket.create_connection(("127.0.0.1", self.port), timeout=10.0) as line, suppress(OSError):
                line.sendall(begin)
                while sent < count:
                    sent += line.send(noise)
            sent += len(begin)
        return []

    def memory_mb(self, which: str) -> float:
        """Return what it takes now (VmRSS), or took at most since it was last asked for now (VmHWM)."""
        folder = Path(f"/proc/{self.nodes.running['operate'].pid}")
        if which == "VmRSS":
            (folder / "clear_refs").write_text("5", encoding="ascii")
        return int((folder / "status").read_text(encoding="ascii").split(f"{which}:")[1].split()[0]) / 1024


def run(options: argparse.Namespace) -> Report:
    """Measure."""
    report = Report("page")
    victim = Victim(options.folder)
    try:
        for _ in range(WARM_UP):
            victim.ask(host="evil.example")
        rows = list(_abuse(victim, *SIZES[options.size]))
        time.sleep(2.0 * GUESS_S)  # who guessed waits, the operator at the same address with him
        is_served = victim.ask() in IN
    finally:
        victim.nodes.end()
    report.tables.append(Table("Strangers", ("what", "asked", "let in", "answers", "MB", "s"), rows))
    report.bounds += [
        Bound("strangers let in", 0, sum(int(row[2]) for row in rows), "", headline=Headline("robustness", "page")),
        Bound("growth of memory, largest of all", 5.0, max(float(row[4]) for row in rows), "MB"),
        Bound("the operator is served afterwards", 1, int(is_served), "", is_minimum=True),
    ]
    return report


def _abuse(victim: Victim, num_guesses: int, num_bytes: int) -> Iterable[tuple[str, ...]]:
    """Yield a row for each way to ask, and for each noise."""
    many: dict[str, list[tuple[str, ...]]] = {
        "another Origin": [(f"/{TOKEN}", "", f"Origin: {origin}", *UPGRADE) for origin in FOREIGN],
        "another Host": [(f"/{TOKEN}", host, *UPGRADE) for host in HOSTS],
        "rebinding: both agree": [(f"/{TOKEN}", host, f"Origin: http://{host}:8461", *UPGRADE) for host in HOSTS],
        "guesses": [(f"/guess{k}",) for k in range(num_guesses)],
    }
    for what, requests in many.items():
        yield _row(victim, what, len(requests), partial(map, lambda words: victim.ask(*words), requests))
    share = num_bytes // len(BEGINS)
    for what, begin in BEGINS.items():
        yield _row(victim, what, share, partial(victim.pour, share, begin))


def _row(victim: Victim, what: str, count: int, act: Callable[[], Iterable[str]]) -> tuple[str, ...]:
    memory, begin = victim.memory_mb("VmRSS"), time.monotonic()
    answers = Counter(act())
    grown, seconds = victim.memory_mb("VmHWM") - memory, time.monotonic() - begin
    told = ", ".join(f"{number} x {status or 'none'}" for status, number in sorted(answers.items()))
    return what, str(count), str(sum(answers[status] for status in IN)), told, f"{grown:.1f}", f"{seconds:.1f}"
