"""Drives from files of taught paths, as the follower reads and smooths them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from path_follower.params import FollowerParams
from path_follower.path_files import read_given
from path_follower.smoothing import TaughtDrive
from path_follower.taught import make_drives
from sphere_nav.geometry.files.untrusted import told_at


def read_drives(file: Path, params: FollowerParams, *, is_reversible: bool = False) -> tuple[list[TaughtDrive], str]:
    """Return the drives of a file of a path, one for each direction in turn, and the id of their map.

    `is_reversible`: what was taught in one direction may be driven in the other one, too. ValueError in one line.
    """
    given = read_given(file)
    with told_at(file):
        taught = make_drives(given, params)
    directions = (1, -1) if is_reversible else (1,)
    return [replace(one, direction=sign * one.direction) for one in taught for sign in directions], given.map_id
