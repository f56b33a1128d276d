"""The simulator's worlds as clouds without colour, ready for the filter; cloud and depth features are kept on disk."""

from __future__ import annotations

import argparse
import hashlib
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mcl_depth
from benchmarks.mcl_drives import HEIGHT, Studio, kept, simulator_source
from benchmarks.mcl_routes import limits
from cycab_sim.town import Plan, draw_plan
from cycab_sim.worlds import geometry_cloud
from mcl_depth.geometry.area import find_area
from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.geometry.ground import Ground
from mcl_depth.geometry.synthesis import DepthSynthesizer, panorama_window
from mcl_depth.image_params import SynthesisParams
from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.params import FilterParams
from mcl_depth.presets import apply_preset
from mcl_depth.site import Site
from typed_params import build

Settings = dict[str, Any]
SPACING = 0.2  # of the points of a cloud, m


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare what all benchmarks in the simulator share."""
    parser.add_argument(
        "--mcl-folder", type=Path, default=None, help="folder of images and depth features (OUTPUT/mcl)"
    )
    parser.add_argument("--world-seed", type=int, default=11, help="seed of world, drives and filter (11)")


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


class Prepared(Site):
    """A site whose depth features are on disk: nothing is drawn before one is missing."""

    def __init__(self, cloud: Cloud, params: FilterParams, name: str, *, is_filled: bool = True) -> None:
        """`name` stands for the cloud in the cache on disk; `is_filled`: all depth features are made now."""
        self.params = params
        heights = Ground(cloud.points).heights
        self.depth_map = DepthMap(Later(cloud, params.synthesis), heights, HEIGHT, params, name)
        self.area = find_area(cloud.points, self.depth_map.heights, params.area)
        if is_filled:
            self.prepare()


class Later:
    """Draws panoramas of a cloud; takes the cloud apart when the first one is asked for."""

    def __init__(self, cloud: Cloud, params: SynthesisParams) -> None:
        self._cloud, self._params, self.camera = cloud, params, panorama_window(params)

    @cached_property
    def drawing(self) -> DepthSynthesizer:
        """What draws."""
        return DepthSynthesizer(self._cloud, self._params)

    def synthesize_many(self, positions: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return ranges (M, H, W) in m around places (M, 3)."""
        return self.drawing.synthesize_many(positions)


def site(world: str, options: argparse.Namespace, settings: Settings, *, is_filled: bool = True) -> Site:
    """Return the site of a world, with the depth features of all its places, or only with those kept on disk."""
    cache = {"cache.folder": str(folder_of(options) / f"depth_{_image_side()}")}
    bare = cloud(world, options)
    params = apply_preset(build(FilterParams, settings | cache), bare.box)
    return Prepared(bare, params, cloud_name(world, options), is_filled=is_filled)


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
