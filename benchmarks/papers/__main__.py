"""`python -m benchmarks.papers`: the drives and figures of the papers, each with a seed, plots, bags and a result."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

from benchmarks.papers.convergence import Convergence
from benchmarks.papers.drives import DRIVES, PaperDrive
from benchmarks.papers.homing import HomingDrive
from benchmarks.papers.hybrid import Hybrid
from benchmarks.papers.kidnapped import Kidnapped
from benchmarks.papers.one_sphere import AroundOneSphere, MadOverDistance, OneSphere
from benchmarks.papers.street import Street
from sphere_nav_tools.cli.demo.watch import DriveFailed

ALL_DRIVES: Mapping[str, type[PaperDrive]] = {**DRIVES, "kidnapped": Kidnapped, "homing": HomingDrive, "hybrid": Hybrid}
OFFLINE: Mapping[str, type[Convergence | OneSphere | Street]] = {  # which nobody is taught for
    "convergence": Convergence,
    "mad": MadOverDistance,
    "around": AroundOneSphere,
    "street": Street,
}
PURPOSES = {name: kind.purpose for name, kind in {**ALL_DRIVES, **OFFLINE}.items()}
LISTING = "\n".join(f"  {name:<16} {purpose}" for name, purpose in PURPOSES.items())
HELP = f"""\
Repeat an experiment of the papers in the simulator, through the real nodes, and write what it gave: bags, plots and
result.json, in which each figure stands beside its bound. Exit status 1 if a bound is not kept.

{LISTING}

The drives teach and map a path first, as `sphere_nav demo` does. --taught uses the map of an earlier one of that seed.

examples:
  python -m benchmarks.papers two_turns --seed 7
  python -m benchmarks.papers reverse --seed 7 --taught out/experiment/two_turns
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("name", metavar="NAME", choices=tuple(PURPOSES), help=", ".join(PURPOSES))
    parser.add_argument("--seed", type=int, default=1, help="decides the town and every noise (%(default)s)")
    parser.add_argument("-o", "--output", type=Path, default=None, metavar="DIR", help="(out/experiment/NAME)")
    parser.add_argument("--taught", type=Path, default=None, metavar="DIR", help="output of an experiment of this seed")
    parser.add_argument("--starts", type=int, default=None, metavar="N", help="of kidnapped (20)")
    parser.add_argument("--domain", type=int, default=None, metavar="N", help="ROS domain (a free one of 50 to 99)")


def run(arguments: argparse.Namespace) -> int:
    """Do it; 1 where a bound is not kept or the drive failed."""
    if arguments.seed < 0:
        raise ValueError(f"--seed: expected 0 or more, found {arguments.seed}")
    name: str = arguments.name
    if arguments.starts is not None and (name != "kidnapped" or arguments.starts < 1):
        raise ValueError(f"--starts: expected 1 or more of kidnapped, found {arguments.starts} of {name}")
    output = arguments.output or Path("out/experiment") / name
    if name in OFFLINE:
        if arguments.taught is not None:
            raise ValueError(f"--taught: expected a drive, found {name}, which is taught nothing")
        return _run_offline(OFFLINE[name](name, output, arguments.seed))
    drive = ALL_DRIVES[name](name, output, arguments.seed, arguments.domain, arguments.taught)
    if isinstance(drive, Kidnapped) and arguments.starts is not None:
        drive.num_starts = arguments.starts
    try:
        return 0 if drive.run() else 1
    except (DriveFailed, RuntimeError) as error:
        print(f"{name}: {error}; what the nodes said is in {drive.folder}")
        return 1


def _run_offline(experiment: Convergence | OneSphere | Street) -> int:
    """Do one without nodes; 1 where a bound is not kept, or a command that it runs failed and has said why."""
    try:
        return 0 if experiment.run() else 1
    except RuntimeError as error:
        print(f"{experiment.name}: {error}; what was made is in {experiment.folder}")
        return 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.papers", description=HELP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_arguments(parser)
    sys.exit(run(parser.parse_args()))
