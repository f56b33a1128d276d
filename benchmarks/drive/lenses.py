"""A street of the simulator mapped by six cameras on one sunny day, driven by other cameras, and by night.

The cameras see 80 to 30 degrees, on another day among other parked cars and traffic, from 1.8 m above the ground as the
map was taken, or from 0.4 m; the night is that of head lamps. All begin from nowhere with odometry, but one, to which
the first pose is given. An error is that of the vehicle relative to the taught drive (`repeats`). Two lenses are dirty.
Then camera_info tells a lens that is too long: it must be named, or the pose withheld; a right one is never called so.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from benchmarks.drive.repeats import MAX_CLOUDS, Drive, Found, Way, localise
from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav.geometry.arrays import Floats
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav_tools.cli.demo.demo import read_truth

DAY, NIGHT = (Drive(*one, 1, MAX_CLOUDS).parameters for one in ((1, ""), (2, "night_lamps")))
LOW = {"camera.mounting_deg": "1,0,0.4,0,0,0"}


class Row(NamedTuple):
    """What is driven: the simulator's parameters, and the least share of moving images in TRACKING, latest start in s.

    is_given: with the pose of the first image. Shares: longer is the lens of camera_info, dirt covers so much.
    """

    name: str
    parameters: dict[str, Any]
    least: float
    latest_s: float
    is_given: bool = False
    longer: float = 0.0
    dirt: float = 0.0


LENSES = ((80, 0.98), (60, 0.98), (50, 0.98), (30, 0.9))
ROWS = (
    *(Row(f"{degrees} deg", DAY | {"camera.view_deg": degrees}, least, 3.0) for degrees, least in LENSES),
    Row("0.4 m above ground", DAY | LOW, 0.95, 3.0),
    Row("first night", NIGHT, 0.9, 3.0),
    Row("first night, pose given", NIGHT, 0.9, 1.0, is_given=True),
    *(Row(f"dirt over {share:.0%}", DAY, least, 3.0, dirt=share) for share, least in ((0.15, 0.99), (0.3, 0.95))),
    *(Row(f"lens {share:.0%} too long", DAY, 0.0, 0.0, longer=share) for share in (0.02, 0.05, 0.07, 0.24)),
)
LENGTHS_M = {"quick": 4.0, "full": 30.0}
QUICK = "80 deg", "first night, pose given", *(row.name for row in ROWS if row.longer or row.dirt)  # that are left out
DIRT_SIDE, DIRT_GRAY, SMEAR = 0.05, 50.0, 0.01  # size of spots and of their rims, as share of the width; grey level
MAX_UNNAMED = 0.3  # of the images, in TRACKING by a wrong lens
MAX_SIGMAS, MAX_OFF = 4.48, 0.05  # chi of 6 numbers that three sigma of one are; share of the poses that is beyond
COLUMNS = ("camera", "images", "TRACKING", "start", "wrong", "lateral RMSE", "RMSE", "worst", "beyond 3 sigma", "else")


def run(options: argparse.Namespace) -> Report:
    """Teach, map, drive, judge."""
    way, is_quick = Way(options.seed, LENGTHS_M[options.size]), options.size == "quick"
    rows = [row for row in ROWS if not (is_quick and row.name in QUICK)]
    taught, found = way.teach(options.folder), list[Found]()
    for number, row in enumerate(rows):
        bag, words = options.folder / row.name.split(",")[0], list[object]()
        if not bag.exists():
            way.record(bag, row.parameters, by_rig=False)
            if row.longer:
                bag = change(bag, "/camera_info", partial(tell_lens, longer=row.longer))
            if row.dirt:
                bag = change(bag, "/image_raw", partial(soil, share=row.dirt, seed=options.seed))
        if row.is_given:
            T_map = taught.T_map[0] @ taught.T_world[0].inverse() @ read_truth(bag).T_map_body[0]
            words = ["--initial-pose", ",".join(f"{x:.6f}" for x in (*T_map.translation, *T_map.quaternion))]
        said = options.folder / f"found_{number}"
        found.append(localise(options.folder / "map", bag, said, taught, *words))
        print(" | ".join(cells(row, found[-1])), file=sys.stderr, flush=True)
    table = Table(f"{way.length_m:g} m of a street", COLUMNS, [cells(*one) for one in zip(rows, found, strict=True)])
    bounds = [bound for one in zip(rows, found, strict=True) for bound in judge(*one, table.title)]
    return Report("lenses", [table], bounds, [__doc__ or ""])


def change(bag: Path, topic: str, edit: Callable[[Any], Any]) -> Path:
    """Return a copy of a bag with other messages of a topic."""
    changed = bag.with_name(f"{bag.name} changed")
    with BagReader(bag) as reader, BagWriter(changed) as writer:
        for info in reader.topics.values():
            writer.add_topic(info.name, info.type, info.profile)
        for name, stamp, message in reader.messages():
            writer.write(name, edit(message) if name == topic else message, stamp)
    return changed


def tell_lens(info: Any, longer: float) -> Any:
    """Return camera_info of a longer lens."""
    info.k[[0, 4]] *= 1.0 + longer
    return info


def soil(message: Any, share: float, seed: int) -> Any:
    """Return an image through a lens of which spots are covered, the same at all times."""
    pixels = conversions.image_to_array(message)
    height, width = pixels.shape[:2]
    cover, dirt = (
        one.reshape(height, width, *[1] * (pixels.ndim - 2)) for one in draw_dirt(width, height, share, seed)
    )
    seen = np.clip(np.rint(pixels + cover * (dirt - pixels)), 0, 255).astype(np.uint8)
    return conversions.array_to_image(seen, conversions.stamp_ns(message), message.header.frame_id, message.encoding)


@lru_cache(maxsize=1)
def draw_dirt(width: int, height: int, share: float, seed: int) -> tuple[Floats, Floats]:
    """Return by how much 0...1 each pixel (height, width) is covered, and the grey levels of what covers it."""
    noise = np.random.default_rng(seed).normal(size=(2, height, width)).astype(np.float32)
    spots, smear = (
        cv2.GaussianBlur(one, (0, 0), size * width) for one, size in zip(noise, (DIRT_SIDE, SMEAR), strict=True)
    )
    cover = cv2.GaussianBlur(np.float32(spots > np.quantile(spots, 1.0 - share)), (0, 0), SMEAR * width)
    return cover, DIRT_GRAY * (1.0 + smear / smear.std() / 4.0)


def judge(row: Row, found: Found, data: str) -> list[Bound]:
    """Return the bounds of a row."""
    if row.longer:
        off = beyond(found) if len(found.sigmas) else 0.0
        return [
            Bound(f"{row.name}: neither named nor withheld", MAX_UNNAMED, found.share, ""),
            Bound(f"{row.name}: TRACKING beyond 3 sigma", MAX_OFF, off, ""),
        ]
    return [
        Bound(f"{row.name}: TRACKING", row.least, found.share, "", True, Headline("other light", data)),
        Bound(f"{row.name}: first pose", row.latest_s, found.start_s, "s"),
        Bound(f"{row.name}: TRACKING beyond 3 sigma", MAX_OFF, beyond(found), ""),
        Bound(f"{row.name}: a right lens called wrong", 0, float("BAD_INFO" in found.why), ""),
    ]


def beyond(found: Found) -> float:
    """Return the share of poses in TRACKING that are more than three sigma off; NaN: none."""
    return float(np.mean(found.sigmas > MAX_SIGMAS)) if len(found.sigmas) else float("nan")


def cells(row: Row, found: Found) -> tuple[str, ...]:
    """Return a row as it is printed."""
    off = np.linalg.norm(found.off[:, :3], axis=1) if len(found.off) else np.full(1, np.nan)
    errors = f"{1e3 * np.sqrt(np.mean(off**2)):.1f} mm", f"{1e3 * off.max():.0f} mm", f"{beyond(found):.1%}"
    return row.name, *found.cells(), *errors, found.why
