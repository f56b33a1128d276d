"""`sphere_nav map-learn`: a map learns from the drives that were kept beside it, or forgets that again."""

from __future__ import annotations

import argparse
from pathlib import Path

from dense_localizer.params import DenseLocalizerParams
from sphere_nav.params import build
from sphere_nav_tools.offline.lessons import PREVIOUS, beside, find_lessons, learn_map, list_drives, take_back
from sphere_nav_tools.offline.settings import add_settings

HELP = """\
Learn from the drives that the localiser has kept beside a map (its parameter learn): a drive that the map explained
badly, in another light for instance, becomes an experience of it. A copy of the map learns it and is examined by the
images that were withheld of that drive and by the other drives: it must explain more of the one, and no fewer of the
others. Then it takes the place of the map, which stays as MAP.previous; frame, poses and taught paths stay. A localiser
that runs goes on with the map that it has opened. Exit status 1 where nothing was learned.

examples:
  sphere_nav localize campus evening -o poses.tum --set learn=true
  sphere_nav map-learn campus --list
  sphere_nav map-learn campus --back
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="only tell which drives were kept, and what is new in them")
    what.add_argument("--back", action="store_true", help="put the map before the present one in its place again")
    parser.add_argument("--experience", default="", metavar="NAME", help="what you call the light or season")
    add_settings(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Learn, list or take back."""
    path: Path = arguments.map.parent if arguments.map.is_file() else arguments.map
    if arguments.back:
        undone = take_back(path)
        told = f"; not learned again: {', '.join(undone)}" if undone else ""
        print(f"{path}: {beside(path, PREVIOUS).name} is in its place again{told}")
        return 0
    if arguments.list:
        drives = list_drives(path)
        lessons = find_lessons(path, drives)
        for drive in drives:
            found = drive.explanation
            what = "to be learned" if drive in lessons else "learned" if found.is_lesson else "explained"
            print(f"{drive.path}: {found.num_explained} of {found.num_images} key images explained: {what}")
        print(f"{path}: {len(drives)} drives, {len(lessons)} to be learned")
        return 0
    params, learned = build(DenseLocalizerParams, {"automatic": False} | arguments.settings), list[bool]()
    for name, is_taken, told in learn_map(path, params, arguments.experience):
        print(f"{name}: {'learned' if is_taken else 'refused'}: {told}")
        learned.append(is_taken)
    print(f"{path}: {sum(learned)} of {len(learned)} drives learned")
    return 0 if any(learned) else 1
