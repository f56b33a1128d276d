"""What a town of the simulator looks like from a place: spheres and images with noise, as a map has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.paths import Path
from cycab_sim.world.worlds import World, build_world
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.sphere import Sphere

HEIGHT_M, NOISE = 1.6, 2.0  # above the ground; grey levels
RANGE_NOISE, FARTHEST_M = 1.5e-3, 60.0  # m/m^2: 0.2 px of a baseline of 0.4 m at 2048 px


def town(seed: int) -> tuple[World, Renderer]:
    """Return the town of a seed and what draws it."""
    world = build_world("town", seed, "block")
    return world, Renderer(world.mesh, RenderParams(), LightParams(), num_threads=1)


def pose_at(path: Path, distance_m: float, aside_m: float = 0.0) -> SE3:
    """Return the pose above a path, moved to the left."""
    x, y, yaw, _ = path.at(np.array(distance_m))
    return SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(np.eye(3), [0.0, aside_m, HEIGHT_M])


def noisy(levels: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return an image as a camera gives it."""
    return np.clip(np.rint(levels + rng.normal(0.0, NOISE, levels.shape)), 1, 255).astype(np.uint8)


def measured(range_m: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return range as a vertical rig measures it: noise grows with the square, and it ends."""
    found = range_m + RANGE_NOISE * np.square(np.minimum(range_m, FARTHEST_M)) * rng.normal(size=range_m.shape)
    found[~(range_m < FARTHEST_M)] = np.nan
    return np.maximum(found, 0.1).astype(np.float32)


def draw(
    renderer: Renderer, pose: SE3, width: int, stamp_ns: int, rng: np.random.Generator, *, is_exact: bool = False
) -> Sphere:
    """Return what a rig sees and measures from a place, in grey; `is_exact`: range has no noise."""
    camera = Spherical(width, width // 2)
    levels, range_m = renderer.render(camera, pose, is_gray=True)
    image = noisy(levels, rng)
    return Sphere(image, range_m.astype(np.float32) if is_exact else measured(range_m, rng), camera, stamp_ns)
