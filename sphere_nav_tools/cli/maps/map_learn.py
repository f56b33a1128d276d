"""`sphere_nav map-learn`: a map learns from the drives that were kept beside it, or forgets that again."""

from __future__ import annotations

import argparse
from pathlib import Path

from dense_localizer.params import DenseLocalizerParams
from sphere_nav.params import build
from sphere_nav_tools.offline.lessons.learning import find_lessons, learn_map, list_drives, take_back
from sphere_nav_tools.offline.settings import add_budget, add_settings

HELP = """\
Learn from the drives that the localiser has kept beside a map (its parameter learn): a drive that the map explained
badly, in another light for instance, becomes an experience of it. A new version of the map is made and examined by the
images that were withheld of that drive and by the other drives: it must explain more, and none may be placed worse.
Then it takes the place of the map by a rename; frame, poses and taught paths stay. Whatever happens before, the old map
stands. A localiser that runs goes on with the map that it has opened. Exit status 1 where nothing was learned.

examples:
  sphere_nav localize campus evening -o poses.tum --set learn=true
  sphere_nav map-learn campus --list
  sphere_nav map-learn campus --budget 3
  sphere_nav map-learn campus --back
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="only tell which drives were kept, and what is new in them")
    what.add_argument("--back", action="store_true", help="put the version before the present one in its place again")
    parser.add_argument("--experience", default="", metavar="NAME", help="what you call the light or season")
    add_budget(parser)
    add_settings(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Learn, list or take back."""
    if arguments.back:
        version, undone = take_back(arguments.map)
        told = f"; not learned again: {', '.join(undone)}" if undone else ""
        print(f"{arguments.map}: version {version.name} is in its place again{told}")
        return 0
    if arguments.list:
        drives = list_drives(arguments.map)
        lessons = find_lessons(arguments.map, drives)
        for drive in drives:
            found = drive.explanation
            what = "to be learned" if drive in lessons else "learned" if found.is_lesson else "explained"
            print(f"{drive.path}: {found.num_explained} of {found.num_images} key images explained: {what}")
        print(f"{arguments.map}: {len(drives)} drives, {len(lessons)} to be learned")
        return 0
    params = build(DenseLocalizerParams, {"automatic": False} | arguments.settings)
    learned = learn_map(arguments.map, params, arguments.experience, arguments.budget)
    for one in learned:
        print(f"{one.drive}: {'learned' if one.is_taken else 'refused'}: {one.told}")
    number = sum(one.is_taken for one in learned)
    print(f"{arguments.map}: {number} of {len(learned)} drives learned")
    return 0 if number else 1
