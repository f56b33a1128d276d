"""Nodes as processes of their own, in a ROS domain of their own or in that of this process, with which they end."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any, Self

import yaml

from sphere_nav.ros.compositions import NodeStart
from sphere_nav.ros.constants import END_PATIENCE_S
from sphere_nav.ros.shared_files import node_entry

# However this process ends, the kernel of Linux then tells its children to (PR_SET_PDEATHSIG is 1).
FOLLOW_PARENT = "import ctypes, signal, sys; ctypes.CDLL(None).prctl(1, signal.SIGTERM)"
NODE = "from {module} import main; sys.exit(main())"
TAIL = 4096  # bytes of what was printed, in which the last line is looked for
FOR_DRIVES = range(50, 100)  # 0 is everybody's, those between are for tests; above 101 the ports are not reserved
_claims: list[int] = []  # descriptors of locked files: the kernel gives the domains free when the process ends


def claim_domain(domains: Iterable[int] = FOR_DRIVES) -> int:
    """Return a ROS domain that is this process's until it ends: a locked file stands for it.

    No other demonstration and no test has it at the same time. RuntimeError where all of them are in use.
    """
    for domain in domains:
        path = Path(tempfile.gettempdir(), f"sphere_nav_domain_{domain}.lock")
        with suppress(OSError):  # locked by a process, or the file of another user who may still use it
            claim = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(claim)
                continue
            _claims.append(claim)
            return domain
    raise RuntimeError(f"ROS domains: expected one of {domains} that is free, found all in use")


def node_command(node: str, *words: str) -> list[str]:
    """Return the command of a node that ends with this process."""
    return python_command(NODE.format(module=node_entry(node).module), *words)


def python_command(code: str, *words: str) -> list[str]:
    """Return the command of Python code; what it imports is what is installed (-P), not what lies in this folder."""
    return [sys.executable, "-P", "-c", f"{FOLLOW_PARENT}; {code}", *words]


def start_command(start: NodeStart, folder: Path) -> list[str]:
    """Return the command of a node as it is described; its parameters go into a file of a folder, the site's first."""
    file, values = folder / f"{start.node}.yaml", {"/**": {"ros__parameters": dict(start.parameters)}}
    file.write_text(yaml.safe_dump(values), encoding="utf-8")
    words = ["--ros-args", *(["-r", f"__ns:=/{start.namespace}"] if start.namespace else [])]
    words += ["--enclave", start.enclave] if start.enclave else []
    for topic, target in start.topics.items():
        words += ["-r", f"{topic}:={target}"]
    for parameters in (start.site, str(file)):
        words += ["--params-file", parameters] if parameters else []
    return node_command(start.node, *words)


class Processes:
    """Starts processes, and ends them all when it is left; what they print goes to a folder, or where ours goes."""

    def __init__(self, folder: Path | None = None, domain_id: int | None = None) -> None:
        """In a domain, seen by this machine alone; None: as this process is."""
        own = {"ROS_DOMAIN_ID": str(domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        self.folder, self._is_kept = folder or Path(), folder is not None
        self.folder.mkdir(parents=True, exist_ok=True)
        self.environment = os.environ | (own if domain_id is not None else {})
        self._starter = ThreadPoolExecutor(max_workers=1)  # children end with the thread that started them
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, node: str, values: Mapping[str, Any]) -> None:
        """Start a node with parameters by dotted name; they are kept in a file beside what it prints."""
        self.begin(node, start_command(NodeStart(node, values), self.folder))

    def begin(self, name: str, command: list[str]) -> subprocess.Popen[bytes]:
        """Start a process, and return it."""
        with (self.folder / f"{name}.log").open("wb") if self._is_kept else nullcontext() as log:
            started = self._starter.submit(
                subprocess.Popen,
                command,
                stdout=log,
                stderr=log and subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=self.environment,
                start_new_session=True,  # Ctrl-C reaches us alone: the order of ending is ours
            )
            self.running[name] = started.result()
        return self.running[name]

    def take_ended(self) -> dict[str, int]:
        """Return the status of each process that has ended since the last call."""
        ended = {name: status for name, process in self.running.items() if (status := process.poll()) is not None}
        for name in ended:
            del self.running[name]
        return ended

    def check(self) -> None:
        """Raise RuntimeError if one has ended by itself; the message shows what it said last."""
        for name, status in self.take_ended().items():
            raise RuntimeError(f"{name} ended with status {status}: {self.last_words(name) or 'it said nothing'}")

    def last_words(self, name: str) -> str:
        """Return the last line that a process printed, empty where it said nothing."""
        with (self.folder / f"{name}.log").open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - TAIL))
            said = log.read().decode("utf-8", "replace").replace("\r", "\n")
        return said.rstrip().rpartition("\n")[2].strip()

    def stop(self, name: str) -> int:
        """End a process as Ctrl-C would, by force if it does not; return its status."""
        process = self.running.pop(name)
        process.send_signal(signal.SIGINT)
        try:
            return process.wait(END_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()

    def end(self) -> dict[str, int]:
        """End what still runs, the last one started first; return the statuses."""
        self.take_ended()
        names = list(reversed(self.running))
        for name in names:
            self.running[name].send_signal(signal.SIGINT)
        return {name: self.stop(name) for name in names}

    def __enter__(self) -> Self:
        """Return self."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """End what still runs."""
        self.close()

    def close(self) -> None:
        """End what still runs; nothing can be started any more."""
        self.end()
        self._starter.shutdown()
