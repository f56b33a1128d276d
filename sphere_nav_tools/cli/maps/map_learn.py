"""`sphere_nav map-learn`: a map learns from the drives that were kept beside it."""

from __future__ import annotations

import argparse
from pathlib import Path

from dense_localizer.params import DenseLocalizerParams
from sphere_nav.params import build
from sphere_nav_tools.offline.lessons import learn_map
from sphere_nav_tools.offline.settings import add, add_settings

HELP = """\
Learn from the drives that the localiser has kept beside a map (its parameter learn): a drive that the map explained
badly, in another light for instance, becomes an experience of it. A copy of the map learns it and is examined by the
images that were withheld of that drive and by the other drives: it must explain more of the one, and no fewer of the
others. Then it takes the place of the map, which stays as MAP.previous; frame, poses and taught paths stay. A localiser
that runs goes on with the map that it has opened. Exit status 1 where nothing was learned.

examples:
  sphere_nav localize campus evening -o poses.tum --set learn=true
  sphere_nav map-learn campus
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "a map (a folder)", Path)
    add_settings(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Learn."""
    path: Path = (arguments.map.parent if arguments.map.is_file() else arguments.map).resolve()
    learned = []
    for name, is_taken, told in learn_map(path, build(DenseLocalizerParams, {"automatic": False} | arguments.settings)):
        print(f"{name}: {'learned' if is_taken else 'refused'}: {told}")
        learned.append(is_taken)
    print(f"{arguments.map}: {sum(learned)} of {len(learned)} drives learned")
    return 0 if any(learned) else 1
