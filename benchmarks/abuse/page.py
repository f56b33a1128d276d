"""What strangers do to the operator's page: other pages, other names, guesses, noise, ways out of the folder."""

from __future__ import annotations

import argparse
import os
import re
import signal
import socket
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav_tools.cli.constants import GUESS_S
from sphere_nav_tools.cli.operate.teaching import Teaching
from sphere_nav_tools.cli.processes import python_command

HELP = "abuse of the operator's page: foreign pages and hosts, guesses, a gigabyte of noise, paths out of the folder"
COMMAND = "from sphere_nav_tools.cli.main import main; sys.exit(main(sys.argv[1:]))"
TOKEN, FOREIGN = "token_of_the_yard", ("http://evil.example", "http://127.0.0.1:1", "http://localhost:8081", "null")
HOSTS = ("evil.example", "127.0.0.1.evil.example", "10.0.0.1", "0.0.0.0")
UPGRADE = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13")
KEY = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
GUESSES, QUICK_GUESSES, PATHS = 10_000, 1000, 50
NOISE, QUICK_NOISE, PIECE = 1 << 30, 64 << 20, 1 << 16  # bytes
IN = ("101", "200")  # answers to who is let in
WARM_UP = 200  # requests before memory is looked at: what is taken once


class Victim:
    """The command in a process of its own."""

    def __init__(self, folder: str) -> None:
        words = ["operate", "--folder", folder, "--token", TOKEN, "--port", "8461"]
        self.process = subprocess.Popen(python_command(COMMAND, *words), stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        found = re.search(r":(\d+)/", self.process.stdout.readline())
        if found is None:
            raise RuntimeError("operate: expected a link, found none")
        self.port = int(found[1])

    def ask(self, path: str = f"/{TOKEN}", host: str = "", *lines: str) -> str:
        """Return the status that a request is answered with; empty: none."""
        head = [f"GET {path} HTTP/1.1", f"Host: {host or '127.0.0.1'}:{self.port}", *lines, "", ""]
        with socket.create_connection(("127.0.0.1", self.port), timeout=10.0) as line, suppress(OSError):
            line.sendall("\r\n".join(head).encode())
            return line.recv(64).decode("latin-1").partition(" ")[2][:3]
        return ""

    def pour(self, count: int, begin: bytes) -> None:
        """Send bytes of noise after a beginning, on as many connections as it takes, read or not."""
        noise, sent = os.urandom(PIECE), 0
        while sent < count:
            with socket.create_connection(("127.0.0.1", self.port), timeout=10.0) as line, suppress(OSError):
                line.sendall(begin)
                while sent < count:
                    sent += line.send(noise)
            sent += len(begin)

    def memory_mb(self, which: str) -> float:
        """Return what it takes now (VmRSS), or took at most since it was last asked for now (VmHWM)."""
        folder = Path(f"/proc/{self.process.pid}")
        if which == "VmRSS":
            (folder / "clear_refs").write_text("5", encoding="ascii")
        return int((folder / "status").read_text(encoding="ascii").split(f"{which}:")[1].split()[0]) / 1024

    def close(self) -> None:
        """End it."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(20.0)


def run(options: argparse.Namespace) -> Report:
    """Measure."""
    report = Report("page")
    with tempfile.TemporaryDirectory() as folder:
        victim = Victim(folder)
        try:
            for _ in range(WARM_UP):
                victim.ask(host="evil.example")
            rows = [_asked(victim, *case) for case in _cases()]
            rows += [_guessed(victim, QUICK_GUESSES if options.size == "quick" else GUESSES)]
            rows += [
                _poured(victim, (QUICK_NOISE if options.size == "quick" else NOISE) // len(BEGINS), name)
                for name in BEGINS
            ]
            time.sleep(2.0 * GUESS_S)  # who guessed waits, the operator at the same address with him
            is_served = victim.ask() in IN
        finally:
            victim.close()
        num_told = _paths_out(Path(folder))
    report.tables.append(Table("Strangers", ("what", "asked", "let in", "answers", "MB", "s"), rows))
    report.bounds += [
        Bound("strangers let in", 0, sum(int(row[2]) for row in rows), "", headline=Headline("robustness", "page")),
        Bound("growth of memory, largest of all", 5.0, max(float(row[4]) for row in rows), "MB"),
        Bound("the operator is served afterwards", 1, int(is_served), "", is_minimum=True),
        Bound(f"different answers to {PATHS} paths out of the folder", 1, num_told, ""),
    ]
    return report


def _cases() -> list[tuple[str, list[tuple[str, ...]]]]:
    key = (*UPGRADE, KEY)
    origins: list[tuple[str, ...]] = [(f"/{TOKEN}", "", f"Origin: {origin}", *key) for origin in FOREIGN]
    hosts: list[tuple[str, ...]] = [(f"/{TOKEN}", host, *key) for host in HOSTS]
    bound: list[tuple[str, ...]] = [(f"/{TOKEN}", host, f"Origin: http://{host}:8461", *key) for host in HOSTS]
    return [("another Origin", origins), ("another Host", hosts), ("rebinding: both agree", bound)]


def _row(victim: Victim, what: str, count: int, act: Callable[[], Counter[str]]) -> tuple[str, ...]:
    memory, begin = victim.memory_mb("VmRSS"), time.monotonic()
    answers = act()
    grown, seconds = victim.memory_mb("VmHWM") - memory, time.monotonic() - begin
    told = ", ".join(f"{number} x {status or 'none'}" for status, number in sorted(answers.items()))
    return what, str(count), str(sum(answers[status] for status in IN)), told, f"{grown:.1f}", f"{seconds:.1f}"


def _asked(victim: Victim, what: str, requests: list[tuple[str, ...]]) -> tuple[str, ...]:
    return _row(victim, what, len(requests), lambda: Counter(victim.ask(*words) for words in requests))


def _guessed(victim: Victim, count: int) -> tuple[str, ...]:
    return _row(victim, "guesses", count, lambda: Counter(victim.ask(f"/guess{k}") for k in range(count)))


HEAD = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
BEGINS = {
    "noise in place of a request": b"",
    "noise as a header": HEAD + b"X: ",
    "noise after a refused handshake": HEAD + "\r\n".join([*UPGRADE, KEY, "", ""]).encode(),
    "noise as one message after it": HEAD + "\r\n".join([*UPGRADE, KEY, "", ""]).encode() + b"\x82\xff" + b"\0" * 6,
}


def _poured(victim: Victim, count: int, name: str) -> tuple[str, ...]:
    def pour() -> Counter[str]:
        victim.pour(count, BEGINS[name])
        return Counter()

    return _row(victim, name, count, pour)


def _paths_out(folder: Path) -> int:
    """Return how many different answers paths out of the folder get, there or not."""
    (folder / "link").symlink_to("/etc")
    names = ["/etc/passwd", "/etc", "../", "link/passwd", "link", "/root/.ssh", "/proc/self/mem", "/dev/null", "", "."]
    names += [f"{'../' * k}etc/passwd" for k in range(1, 21)] + [f"/nothing/{k}" for k in range(PATHS - 30)]
    teaching = Teaching(folder, [], [])
    told = {(teaching.path_of(name), teaching.map_of(name), teaching.map(name)) for name in names}
    teaching.close()
    return len(told)
