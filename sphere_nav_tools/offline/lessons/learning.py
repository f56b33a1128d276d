"""READ FIRST. A map learns from the drives that were kept beside it: one after the other, each a version of its own.

Make the map that also knows the drive; examine both maps by what was withheld of it, and by all other drives that are
kept: it must explain more of this one, and none of the others may be placed worse. Then the new version takes the place
of the old one, which stays as `--back`; else the drive is put aside.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dense_localizer.params import LocalizerParams
from dense_localizer.references.rejections import Rejections
from sphere_mapping.experiences.budget import Budget
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.ros.service import one_line
from sphere_nav_tools.offline.constants import MAX_EXAMINED, MAX_JUDGES
from sphere_nav_tools.offline.forgetting import together
from sphere_nav_tools.offline.lessons.examination import localize_key_images
from sphere_nav_tools.offline.lessons.kept_drives import KeptDrive, KeyImage, find_drives
from sphere_nav_tools.offline.lessons.teaching import Lesson, teach
from sphere_nav_tools.offline.lessons.versions import Versions


@dataclass(frozen=True)
class Learned:
    """What became of a drive: whether the map is a new one now, and why, in words."""

    drive: str
    is_taken: bool
    told: str


def list_drives(map_path: Path) -> list[KeptDrive]:
    """Return the drives that were kept in a map of the present frame, the oldest first."""
    with open_map(map_path) as reader:
        drives = find_drives(map_path, str(reader.info.header.frame_id))
        return [one for one in drives if _map_id(one) == str(reader.info.map_id)]


def find_lessons(map_path: Path, drives: Sequence[KeptDrive]) -> list[KeptDrive]:
    """Return the drives that the map explained badly, and does not know yet."""
    with open_map(map_path) as reader:
        known = {node.experience.drive for node in reader.graph}
    return [one for one in drives if one.explanation.is_lesson and one.name not in known]


def learn_map(map_path: Path, params: LocalizerParams, name: str = "", budget: Budget | None = None) -> list[Learned]:
    """Learn all lessons that wait beside a map; return what became of each. OSError: the map is as it was."""
    versions = Versions(map_path)
    with versions.locked():
        drives = list_drives(map_path)
        found = []
        for drive in find_lessons(map_path, drives):
            found.append(_learn(versions, drive, [one for one in drives if one is not drive], params, name, budget))
            if not found[-1].is_taken:
                drive.refuse()
                drives.remove(drive)
    return found


def take_back(map_path: Path) -> tuple[Path, list[str]]:
    """Put the version before the present one in its place; what only the present one knows is not learned again."""
    versions = Versions(map_path)
    with versions.locked():
        drives, before = list_drives(map_path), _known(map_path)
        version = versions.take_back()
        undone = [one for one in drives if one.name in before - _known(map_path)]
        for drive in undone:
            drive.refuse()
    return version, [one.name for one in undone]


def _learn(
    versions: Versions,
    drive: KeptDrive,
    others: list[KeptDrive],
    params: LocalizerParams,
    name: str,
    budget: Budget | None,
) -> Learned:
    """Make the next version of a map, judge it, put it in its place."""
    try:
        with open_map(versions.map) as base:
            lesson = Lesson.of(drive, base.graph)
            num_new = teach(base, drive, lesson.taught, versions.next, _contradicted(base, others), name, budget)
        problems = verify_map(versions.next)
        if not num_new or problems:
            told = problems[0] if problems else "no key sphere of it could be made"
            return Learned(drive.name, is_taken=False, told=told)
        with open_map(versions.map, is_gray=True) as before, open_map(versions.next, is_gray=True) as after:
            told, is_better = _judge(before, after, lesson.withheld, others, params)
        if is_better:
            kept = versions.put_next()
            told = f"{num_new} key spheres; {told}; before: {kept}"
        return Learned(drive.name, is_better, told)
    finally:
        versions.drop_next()


def _judge(
    before: MapReader,
    after: MapReader,
    withheld: Sequence[KeyImage],
    others: Sequence[KeptDrive],
    params: LocalizerParams,
) -> tuple[str, bool]:
    """Say what a new version is worth, and whether it may take the place of the old one."""
    marks = [localize_key_images(reader, _spread(withheld), params) for reader in (before, after)]
    gain = f"explains {marks[1].num_explained} of {len(marks[1].placements)} withheld images"
    told = f"{gain}, before {marks[0].num_explained}"
    if marks[1].num_explained <= marks[0].num_explained or marks[1].num_placed < marks[0].num_placed:
        return told, False
    known = {node.experience.drive for node in before.graph}
    for drive in others[-MAX_JUDGES:]:
        images = _spread([one for one in drive.images() if one.is_explained or drive.name in known])
        old, new = (localize_key_images(reader, images, params) for reader in (before, after))
        if worse := old.find_worse(new):
            return f"{told}; {drive.name}: {worse}", False
    return f"{told}; {min(len(others), MAX_JUDGES)} other drives as before", True


def _contradicted(base: MapReader, drives: Sequence[KeptDrive]) -> Rejections:
    """Return what drives that the map explained have contradicted: in another light all looks contradicted."""
    map_id = str(base.info.map_id)
    return together([one.rejections(map_id) for one in drives if not one.explanation.is_lesson])


def _map_id(drive: KeptDrive) -> str:
    """Return the map that a drive was kept in; nothing where it is damaged, which is told."""
    try:
        return drive.map_id
    except (BagError, OSError) as error:
        logging.getLogger("sphere_nav.learn").warning("%s: left out: %s", drive.path, one_line(error))
        return ""


def _spread(images: Sequence[KeyImage]) -> list[KeyImage]:
    step = -(-len(images) // MAX_EXAMINED) or 1
    return list(images[::step])


def _known(map_path: Path) -> set[str]:
    with open_map(map_path) as reader:
        return {node.experience.drive for node in reader.graph}
