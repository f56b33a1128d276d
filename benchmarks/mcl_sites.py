"""The simulator's worlds as clouds without colour, ready for the filter; cloud and depth features are kept on disk."""

from __future__ import annotations

import argparse
import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mcl_depth
from benchmarks.mcl_drives import HEIGHT, LIGHTS, NIGHT, Studio, kept, simulator_source
from benchmarks.mcl_routes import limits
from cycab_sim.params import LightParams
from cycab_sim.world.town import Plan, draw_plan
from cycab_sim.world.worlds import geometry_cloud
from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.params import build

Settings = dict[str, Any]
SPACING = 0.2  # of the points of a cloud, m


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare what all benchmarks in the simulator share."""
    parser.add_argument(
        "--mcl-folder", type=Path, default=None, help="folder of images and depth features (OUTPUT/mcl)"
    )
    parser.add_argument(
        "--likeness",
        choices=("gradients", "learned", "both"),
        default="gradients",
        help="of image and depth (gradients)",
    )
    parser.add_argument("--night", action="store_true", help="drives by night: street lamps, and the head lamp")
    parser.add_argument("--world-seed", type=int, default=11, help="seed of world, drives and filter (11)")


def kinds_of(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the kinds of likeness that are measured, one beside the other."""
    return ("gradients", "learned") if options.likeness == "both" else (options.likeness,)


def lights_of(options: argparse.Namespace) -> tuple[LightParams, ...]:
    """Return the lights that drives take in turn."""
    return (NIGHT,) if options.night else LIGHTS


def of_kind(options: argparse.Namespace, kind: str) -> argparse.Namespace:
    """Return the options of one kind of likeness."""
    return argparse.Namespace(**vars(options) | {"likeness": kind})


def folder_of(options: argparse.Namespace) -> Path:
    """Return where recordings are kept."""
    return options.mcl_folder if options.mcl_folder is not None else options.output / "mcl"


def studio(world: str, options: argparse.Namespace) -> Studio:
    """Return the world in which drives are recorded."""
    return Studio(world, options.world_seed, folder_of(options))


def town_settings(plan: Plan, changes: Settings | None = None) -> Settings:
    """Return what a user gives for the 100 x 100 m around the middle of a town; all else is the preset's."""
    box = ",".join(f"{value:.2f}" for value in limits(plan))
    return {"area.limits": box} | (changes or {})


def town(options: argparse.Namespace, changes: Settings | None = None, *, is_filled: bool = True) -> tuple[Site, Plan]:
    """Return the site of a town and its plan."""
    plan = draw_plan(options.world_seed)
    return site("town", options, town_settings(plan, changes), is_filled=is_filled), plan


def site(world: str, options: argparse.Namespace, settings: Settings, *, is_filled: bool = True) -> Site:
    """Return the site of a world, with the depth features of all its places, or only with those kept on disk."""
    cache = {"cache.folder": str(folder_of(options) / f"depth_{_image_side()}")}
    likeness = {"likeness.kind": options.likeness}
    return Site(cloud(world, options), HEIGHT, build(FilterParams, settings | cache | likeness), is_ready=is_filled)


def cloud(world: str, options: argparse.Namespace) -> Cloud:
    """Return the bare geometry of a world, without what comes and goes."""
    path = folder_of(options) / f"cloud_{cloud_name(world, options)}.npy"

    def make() -> NDArray[np.float32]:
        return geometry_cloud(options.world_seed, SPACING, world).astype(np.float32)

    return cloud_from_points(kept(path, make), world)


def cloud_name(world: str, options: argparse.Namespace) -> str:
    """Return what decides a cloud, hashed."""
    return hashlib.sha256(simulator_source() + f"{world} {options.world_seed} {SPACING}".encode()).hexdigest()[:16]


@lru_cache(maxsize=1)
def _image_side() -> str:
    """Return what the source that makes depth features hashes to: kept features must not outlive it."""
    folder = Path(mcl_depth.__file__).parent
    key = hashlib.sha256()
    for part in ("geometry", "likeness"):
        for path in sorted((folder / part).rglob("*.py")):
            key.update(path.read_bytes())
    return key.hexdigest()[:12]
