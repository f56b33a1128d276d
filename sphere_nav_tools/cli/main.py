"""The `sphere_nav` command. A subcommand is a file with HELP, `add_arguments(parser)` and `run(arguments)`.

`run` returns the exit status: 0 or None done, 1 the work failed, 2 misuse or bad input (one line on stderr), 130
interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import logging
import logging.handlers
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from sphere_nav.params.homes import at_home
from sphere_nav.ros.service import one_line
from sphere_nav.ros.shared_files import software
from sphere_nav_tools.offline.settings import check_files
from sphere_nav_tools.offline.tables import columns

DEBUG_VARIABLE = "SPHERE_NAV_DEBUG"


COMMANDS = {  # the module that carries it out, and what it does
    "import": ("import_", "turn a recorded data set into a bag with our topics and its truth"),
    "calibrate": ("calibrate", "find the parameters of a rig of cameras from images of a board"),
    "rig-convert": ("rig_convert", "turn a file of Kalibr, basalt or OpenCV into a rig file"),
    "register": ("register", "align two spheres, RGB-D images or stereo pairs"),
    "inspect": ("bags.inspect_", "tell what a bag offers, and what to type"),
    "map": ("maps.map", "make a map of key spheres from a bag"),
    "localize": ("localize", "find the camera of a bag in a map"),
    "refine-camera": ("refine_camera", "find lens and readout time of a camera by a drive in a map"),
    "mcl": ("mcl", "find the camera of a bag in a point cloud"),
    "map-info": ("maps.map_info", "tell what is in a map"),
    "map-verify": ("maps.map_verify", "check every sphere of a map, salvage a damaged one"),
    "map-export": ("maps.map_export", "write a map as point cloud, graph or trajectory"),
    "map-learn": ("maps.map_learn", "learn from the drives that were kept beside a map"),
    "route": ("route", "make a network of taught paths with named places, plan ways on it"),
    "view": ("view", "look around in a map, in a web browser"),
    "evaluate": ("evaluate", "compare estimated poses with the truth"),
    "plot": ("plot", "draw what a localiser said: path, errors, states, timings"),
    "verify-bag": ("bags.verify_bag", "check every message of a bag, salvage a damaged one"),
    "record": ("bags.record", "record topics into a bag"),
    "play": ("bags.play", "publish the messages of a bag"),
    "up": ("up", "start nodes that belong together, as ros2 launch does"),
    "keystore": ("keystore", "make the keys of nodes that belong together (SROS2)"),
    "operate": ("operate.operate", "an operator's page: teach, drive, pause, stop, see why it stands"),
    "demo": ("demo.demo", "teach, map and drive a loop in the simulator"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand and return the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        return _dispatch(words)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of our output, `head` perhaps, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError) as error:
        if os.environ.get(DEBUG_VARIABLE) == "1":
            raise
        name = f" {words[0]}" if words and words[0] in COMMANDS else ""
        print(f"sphere_nav{name}: {one_line(error)}", file=sys.stderr)
        return 2


def _dispatch(words: list[str]) -> int:
    if words and words[0] in COMMANDS:
        module = importlib.import_module(f"sphere_nav_tools.cli.{COMMANDS[words[0]][0]}")
        raw = argparse.RawDescriptionHelpFormatter
        parser = _Parser(f"sphere_nav {words[0]}", None, module.HELP, formatter_class=raw, allow_abbrev=False)
        module.add_arguments(parser)
        arguments = parser.parse_args(words[1:])
        for name, value in vars(arguments).items():
            setattr(arguments, name, [at_home(one) for one in value] if isinstance(value, list) else at_home(value))
        check_files(arguments)
        arguments.words = words
        with _log_at_the_end():
            return int(module.run(arguments) or 0)
    if not words or words[0] in ("-h", "--help", "help"):
        print(_overview())
        return 0 if words else 2
    if words[0] == "--version":
        print(software())
        return 0
    raise ValueError(f"expected a command ({', '.join(COMMANDS)}), found {words[0]!r}")


@contextmanager
def _log_at_the_end() -> Iterator[None]:
    """Keep what nodes of a replay log away from progress bars, and let the one line of an error stand alone."""
    log = logging.getLogger("sphere_nav")
    shown = logging.StreamHandler()
    shown.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    held = logging.handlers.MemoryHandler(100_000, flushLevel=logging.CRITICAL + 1, target=shown)
    log.addHandler(held)
    try:
        yield
    except (ValueError, OSError):
        held.buffer.clear()
        raise
    finally:
        log.removeHandler(held)
        held.close()


class _Parser(argparse.ArgumentParser):
    """Tells a mistake in one line, and takes -0.1,0,1 behind an option for its value."""

    def __init__(self, *words: Any, **options: Any) -> None:
        super().__init__(*words, **options)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (--help explains)\n")


def _overview() -> str:
    return "\n".join(
        [
            "usage: sphere_nav COMMAND ...\n\nTeach a vehicle a place once, then drive there by one camera.\n",
            *columns((f"  {name}", summary) for name, (_, summary) in COMMANDS.items()),
            "\n'sphere_nav COMMAND --help' explains a command and gives examples. Exit status: 0 done, 1 failed,",
            f"2 misuse or bad input. {DEBUG_VARIABLE}=1 shows where an error comes from.",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
