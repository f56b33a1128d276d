"""`sphere_nav map-forget`: a new map without what drives have rejected again and again."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from dense_localizer.references.rejections import Rejections, read_rejections
from sphere_nav.ros.maps.reader import MapDetails, MapReader, open_map, save_map
from sphere_nav.spheres.sphere import Sphere

HELP = """\
Make a new map of one and of what `sphere_nav localize --rejections` has counted in it: squares of key spheres that most
images contradicted (leaves, a car that was parked there) lose their range, so that no image is aligned with them. The
map itself is never changed. Several drives count together.

examples:
  sphere_nav localize campus tuesday -o tuesday.tum --rejections tuesday.json
  sphere_nav localize campus friday -o friday.tum --rejections friday.json
  sphere_nav map-forget campus tuesday.json friday.json -o campus_2
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    parser.add_argument(
        "rejections", type=Path, nargs="+", metavar="FILE", help="what localize --rejections has written"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="NEW", help="map to write")


def run(arguments: argparse.Namespace) -> int:
    """Write the new map; 1 where there is nothing to forget."""
    with open_map(arguments.map) as reader:
        map_id = str(reader.info.map_id)
        rejections = together([read_rejections(path, map_id) for path in arguments.rejections])
        shares = [share for share in (rejections.share(node.id) for node in reader.graph) if share]
        if not shares:
            print(f"{arguments.map}: nothing to forget")
            return 1
        info = reader.info
        details = MapDetails(
            source=f"{info.source} without rejections",
            parameters=reader.parameters,
            rig=info.rig,
            frame_id=info.header.frame_id,
        )
        with tqdm(total=len(reader.graph), desc="forget", unit="sphere", disable=None) as bar:
            known = partial(load, reader, rejections), reader.appearance()
            save_map(
                arguments.output,
                reader.graph,
                details,
                load_sphere=known[0],
                appearance=known[1],
                progress=bar.update,
            )
    print(f"{arguments.output}: {len(shares)} key spheres, up to {max(shares):.1%} of their pixels forgotten")
    return 0


def together(parts: list[Rejections]) -> Rejections:
    """Return what several drives have counted."""
    counts: dict[int, NDArray[np.int64]] = {}
    for part in parts:
        for sphere_id, count in part.counts.items():
            counts[sphere_id] = counts.get(sphere_id, np.zeros_like(count)) + count
    return Rejections(counts)


def load(reader: MapReader, rejections: Rejections, sphere_id: int) -> Sphere:
    """Return a key sphere without range where it is forgotten."""
    sphere = reader.load_sphere(sphere_id)
    unused = rejections.mask(sphere_id, sphere.camera)
    if unused is None:
        return sphere
    nan, std_m = np.float32(np.nan), sphere.range_std_m
    left = None if std_m is None else np.where(unused, nan, std_m)
    filled = None if sphere.is_filled is None else sphere.is_filled & ~unused
    return replace(sphere, range_m=np.where(unused, nan, sphere.range_m), range_std_m=left, is_filled=filled)
