"""`python -m benchmarks GROUP [NAME ...]`: measure; print Markdown, write JSON. Exit code: 1 one broke, 2 one refused.

A benchmark is a module `GROUP/NAME.py` with `run(options) -> Report`. It is imported only to run: what `--help` tells
of it is read from its text, the first line.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import traceback
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.machine import commit, describe, num_cores, set_threads
from benchmarks.report import Report

FOLDER = Path(__file__).resolve().parent
GROUPS = {
    "real": "poses and maps by recorded images",
    "drive": "following, missions and drives that teach",
    "light": "a map by day, images of another hour",
    "mapping": "spheres, ranges, graphs and maps",
    "bare": "places by bare geometry",
    "calibration": "rigs by boards",
    "safety": "faults, false places, stops",
    "times": "times, memory, rates",
    "abuse": "wrong files and messages, long runs",
}
ROS = {"ROS_DOMAIN_ID": "48", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
PLACES = {"--seed", "--json", "--threads"}  # options, and their values, that do not stand on a page
IS_BENCHMARK, FIRST_LINE = "\ndef run(", r'"""(.*?)("""|\n)'


@cache
def names(group: str) -> dict[str, str]:
    """Return what each benchmark of a group is said to measure, by name, without importing it."""
    paths = sorted((FOLDER / group).glob("*.py"))
    texts = {path.stem: path.read_text(encoding="utf-8") for path in paths}
    found = {name: re.match(FIRST_LINE, text) for name, text in texts.items() if IS_BENCHMARK in text}
    return {name: told[1] for name, told in found.items() if told}


def main(words: list[str]) -> int:
    """Run what the command line names."""
    group = words[0] if words else ""
    if group == "ablation":
        return int(importlib.import_module("benchmarks.ablation").main(_parser(group, {}), words[1:]))
    if group != "all" and group not in GROUPS:
        return _tell_groups(is_wrong=group not in ("", "-h", "--help"))
    places = {name: one for one in GROUPS if group in ("all", one) for name in names(one)}
    parser = _parser(group, places)
    options = parser.parse_args(words[1:])
    if unknown := [name for name in options.names if name not in places]:
        parser.error(f"NAME: expected one of {', '.join(places)}, found {unknown[0]}")
    chosen = options.names or list(places)
    if options.json and len(chosen) != 1:
        parser.error(f"--json: expected one NAME, found {len(chosen)}")
    options.seed = random.randrange(1, 10_000) if options.seed is None else options.seed
    own = [word for word in words[1:] if word not in options.names]
    if len(chosen) == 1:
        return _run_one(places[chosen[0]], chosen[0], options, own)
    return _run_each([(places[name], name) for name in chosen], options.seed, own)


def _module(group: str, name: str) -> Any:
    return importlib.import_module(f"benchmarks.{group}.{name}")


def _tell_groups(is_wrong: bool) -> int:
    lines = [f"  {group:12} {told}: {', '.join(names(group))}" for group, told in GROUPS.items()]
    text = "\n".join(["usage: python -m benchmarks GROUP|all|ablation [NAME ...] [--help]", "", *lines])
    print(text, file=sys.stderr if is_wrong else sys.stdout)
    return 2 if is_wrong else 0


def _parser(group: str, places: dict[str, str]) -> argparse.ArgumentParser:
    listing = "\n".join(f"  {name:18} {names(one)[name]}" for name, one in places.items())
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks {group}",
        description=f"{GROUPS.get(group, 'all groups')}\n\n{listing}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="benchmarks to run (all of the group)")
    parser.add_argument("--seed", type=int, metavar="N", help="of all that is drawn (a new one, which is printed)")
    parser.add_argument("--size", choices=("quick", "full"), default="full", help="quick: fewer and smaller (full)")
    parser.add_argument("--json", type=Path, metavar="F", help="file of what one NAME measured (out/bench/NAME.json)")
    threads = min(num_cores(), 2)
    parser.add_argument("--threads", type=int, default=threads, metavar="N", help="of every library (%(default)s)")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of recordings (%(default)s)")
    return parser


def _run_each(chosen: list[tuple[str, str]], seed: int, own: list[str]) -> int:
    """Run several, each in a process of its own: none lives on the memory or the caches of another."""
    codes = []
    for group, name in chosen:
        words = ["-m", "benchmarks", group, name, *own, "--seed", str(seed)]
        codes.append(subprocess.run([sys.executable, *words], check=False).returncode)
    wrong = [name for (_, name), code in zip(chosen, codes, strict=True) if code]
    print(f"{len(chosen)} benchmarks, seed {seed}; broken or refused: {', '.join(wrong) or 'none'}")
    return max(abs(code) for code in codes)


def _run_one(group: str, name: str, options: argparse.Namespace, own: list[str]) -> int:
    print(f"{group} {name}: seed {options.seed}, {options.size}", flush=True)
    module = _module(group, name)  # first: libraries that are loaded after it take twice the CPU
    set_threads(options.threads)
    for variable, value in ROS.items():
        os.environ.setdefault(variable, value)
    start = time.monotonic()
    try:
        with tempfile.TemporaryDirectory() as folder:
            options.folder = Path(folder)
            report: Report = module.run(options)
    except (ValueError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except Exception:
        print(f"{name} broke:", file=sys.stderr)
        traceback.print_exc()
        return 1
    print(report.markdown(), end="\n\n", flush=True)
    path = options.json or Path("out/bench") / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = [word for word, last in zip(own, ["", *own], strict=False) if {word, last}.isdisjoint(PLACES)]
    words = " ".join(["python -m benchmarks", group, name, *kept, "--seed", "N"])
    head = {"group": group, "name": name, "command": words, "seed": options.seed, "size": options.size}
    head |= {"seconds": round(time.monotonic() - start), "machine": describe(options.threads), "commit": commit()}
    path.write_text(json.dumps(head | report.as_mapping(), indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
