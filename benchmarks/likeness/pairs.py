"""Pairs of panoramas and depth panoramas for `train.py`, drawn by the simulator and kept on disk.

A scene is one world in one light: images of K places as the filter has them (level, 2 degrees a pixel, heading 0), and
for each place J depth panoramas of the bare map: J_NEAR of where the cell of a map that holds the place may have its
middle, the others of places nearby that are wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bare.drives import CLEAR, LIGHTS, NIGHT, PANORAMA, SHADOWLESS, TILT_DEG, kidnapped_line, take
from benchmarks.bare.home_world import HEIGHT as HOME_HEIGHT
from benchmarks.bare.home_world import PANORAMA as HOME_PANORAMA
from benchmarks.bare.home_world import home
from cycab_sim.params import LightParams, RenderParams, TrafficParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world import finishes
from cycab_sim.world.mesh import BOX_FACES, Mesh, MeshBuilder
from cycab_sim.world.town import draw_plan
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import build_world, geometry_cloud
from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.mesh import mesh_from_faces, sample_surface
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.level_view import level_view
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array

NIGHT_TORCH = LightParams(sun="300,22.0h", torch=6000.0, exposure=900.0)
OVERCAST = LightParams(sun="120,10.0h", overcast=1.0, exposure=1.6)
TOWN_LIGHTS = (*LIGHTS, NIGHT, NIGHT_TORCH, OVERCAST)
CORRIDOR_LIGHTS = (SHADOWLESS, NIGHT_TORCH, OVERCAST, LIGHTS[0])
J_NEAR, J_WRONG, J_ANYWHERE = 2, 4, 2
TOWN_IMAGES, CORRIDOR_IMAGES, HOME_IMAGES = 28, 36, 16
VERSION = 1  # of the pairs on disk: to be raised with every change of what is drawn


@dataclass(frozen=True, eq=False)
class Scene:
    """images (K, H, W) f2, their places (K, 2) m; depths (K, J, H, W) f2 m, NaN unknown, and their places (K, J, 2)."""

    kind: str
    images: NDArray[np.float16]
    places: Array
    depths: NDArray[np.float16]
    depth_places: Array


def scenes(folder: Path, towns: range, corridors: range, homes: range) -> Iterator[Scene]:
    """Yield the scenes of some seeds of each kind, drawn where the folder does not hold them."""
    jobs: list[tuple[str, int, int]] = []
    jobs += [("town", seed, light) for seed in towns for light in range(seed % 2, len(TOWN_LIGHTS), 2)]  # every other
    jobs += [("corridor", seed, seed % len(CORRIDOR_LIGHTS)) for seed in corridors]
    jobs += [("home", seed, 0) for seed in homes]
    for kind, seed, light in jobs:
        yield _kept(folder, kind, seed, light)


def _kept(folder: Path, kind: str, seed: int, light: int) -> Scene:
    name = f"{kind}_{seed}_{light}_v{VERSION}.npz"
    path = folder / name
    names = ("images", "places", "depths", "depth_places")
    if not path.exists():
        make: dict[str, Callable[[int, int], tuple[Any, ...]]] = {"town": _town, "corridor": _corridor, "home": _home}
        made = make[kind](seed, light)
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_suffix(".part.npz")
        arrays: dict[str, Any] = dict(zip(names, made, strict=True))
        np.savez(draft, **arrays)
        draft.replace(path)
    with np.load(path, allow_pickle=False) as file:
        return Scene(kind, *(file[name] for name in names))


def _town(seed: int, light: int) -> tuple[Any, ...]:
    """Return the arrays of one light in the town of a seed: drives of four images, 3 m apart."""
    rng, plan = np.random.default_rng([seed, light, 13]), draw_plan(seed)
    poses = np.concatenate([kidnapped_line(plan, 4, 3.0, rng) for _ in range(TOWN_IMAGES // 4)])
    world = build_world("town", seed, "block")
    synthesizer = _town_synthesizer(seed)
    traffic = Traffic(world, TrafficParams(density="usual", may_cross=True), seed)
    return _record(world.mesh, traffic, synthesizer, poses, 1.8, 0.5, TOWN_LIGHTS[light], rng)


_synthesizers: dict[int, DepthSynthesizer] = {}


def _town_synthesizer(seed: int) -> DepthSynthesizer:
    if seed not in _synthesizers:
        _synthesizers.clear()
        cloud = cloud_from_points(geometry_cloud(seed, 0.2, "town").astype(np.float32), "town")
        _synthesizers[seed] = DepthSynthesizer(cloud, SynthesisParams(voxel_m=0.2))
    return _synthesizers[seed]


def _corridor(seed: int, light: int) -> tuple[Any, ...]:
    """Return the arrays of a corridor of its own measures."""
    rng = np.random.default_rng([seed, 17])
    mesh, length, half = draw_corridor(rng)
    x = rng.uniform(1.0, length - 1.0, CORRIDOR_IMAGES)
    y, yaw = rng.uniform(-0.6, 0.6, len(x)) * half, rng.choice([0.0, np.pi], len(x)) + rng.normal(0.0, 0.3, len(x))
    faces = mesh.triangles.astype(np.float64)
    surface = mesh_from_faces(faces.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), "corridor")
    geometry = sample_surface(surface, 0.12) if rng.random() < 0.7 else surface
    synthesizer = DepthSynthesizer(geometry, SynthesisParams(voxel_m=float(rng.choice([0.1, 0.2]))))
    poses, height = np.column_stack([x, y, yaw]), float(rng.uniform(1.2, 2.0))
    return _record(mesh, None, synthesizer, poses, height, 0.3, CORRIDOR_LIGHTS[light], rng)


def draw_corridor(rng: np.random.Generator) -> tuple[Mesh, float, float]:
    """Return a corridor along x from 0, its length and half width: bays, niches, doors, cupboards, end walls."""
    mesh = MeshBuilder(rng)
    length, half, top = rng.uniform(30.0, 140.0), rng.uniform(0.9, 3.0), rng.uniform(2.4, 4.2)
    bay, niche, deep = rng.uniform(3.5, 12.0), rng.uniform(0.8, 2.2), rng.uniform(0.15, 1.2)
    wall, floor = finishes.wall(rng), (finishes.PAVING, finishes.COBBLES, finishes.TRIM)[int(rng.integers(3))]
    ceiling = (finishes.TRIM, finishes.ROOF_FLAT)[int(rng.integers(2))]
    door = finishes.slats(finishes.pick(rng, finishes.WOODWORK))
    has_niche = np.array([True, True]) if rng.random() < 0.6 else rng.random(2) < 0.5
    mesh.panels(BOX_FACES[5] * [length, 2 * half + 4, 0] - [0, half + 2, 0], finishes.ROOF_FLAT)
    mesh.panels([[[0, -half, 0], [length, -half, 0], [length, half, 0], [0, half, 0]]], floor)
    mesh.panels([[[0, half, top], [length, half, top], [length, -half, top], [0, -half, top]]], ceiling)
    for x in (-0.3, length):
        mesh.box([x, -half - 2.0, 0], [0.3, 2 * half + 4.0, top], finishes.wall(rng) if rng.random() < 0.5 else wall)
    for x, size in ((length - 0.05, 0.05), (0.0, 0.05)):
        if rng.random() < 0.6:
            width = min(rng.uniform(0.8, 1.6), 1.8 * half)
            mesh.box([x, -0.5 * width, 0], [size, width, min(2.2, top)], door)
    is_regular = rng.random() < 0.6
    for side, has in zip((-1.0, 1.0), has_niche, strict=True):
        edge: Any = 0.0
        while edge < length:
            step = bay if is_regular else rng.uniform(0.6, 1.4) * bay
            stop, gap = min(edge + step, length), min(niche, 0.5 * step) if has and deep > 0.0 else 0.0
            low = half if side > 0 else -half - deep
            mesh.box([edge, low, 0], [max(stop - gap - edge, 0.05), deep, top], wall)
            back = half + deep if side > 0 else -half - deep - 0.1
            mesh.box([stop - gap - 0.01, back, 0], [gap + 0.02, 0.1, top], door if rng.random() < 0.7 else wall)
            if rng.random() < 0.12:  # a cupboard
                body = np.array([rng.uniform(0.5, 1.5), min(rng.uniform(0.2, 0.6), 0.5 * half), rng.uniform(0.8, top)])
                at = [edge + 0.3, half - body[1] if side > 0 else -half, 0.0]
                mesh.box(at, body, finishes.painted_metal(finishes.pick(rng, finishes.CARS)))
            edge = stop
    return mesh.build(), length, half


def _record(
    mesh: Mesh,
    traffic: Traffic | None,
    synthesizer: DepthSynthesizer,
    poses: Array,
    height: float,
    cell: float,
    light: LightParams,
    rng: np.random.Generator,
) -> tuple[Any, ...]:
    """Draw a car's panoramas at planar poses (K, 3) of the camera, and depths around them; `cell` m to its corners."""
    renderer = Renderer(mesh, RenderParams(shadow_texel=0.0 if light == SHADOWLESS else 0.1), light, traffic)
    images = []
    for index, (x, y, yaw) in enumerate(poses):
        T_map_base = SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(np.eye(3), [-0.4, 0.0, 0.0])
        T_map_camera = T_map_base @ SE3.from_parts(np.eye(3), [0.4, 0.0, height])
        if traffic is not None:
            renderer.move(traffic.poses(index * 10**9, T_map_camera.translation[None, :2], CLEAR))
        seed = (*(int(n) for n in rng.integers(1 << 30, size=2)), index)
        image = take(renderer, light, PANORAMA.camera, T_map_base, T_map_camera, seed)
        turn = so3.exp(np.array([0.0, 0.0, float(yaw)])) @ _tilt(rng)
        images.append(level_view(image, PANORAMA.camera, turn, synthesizer.camera)[0])
    depths, places = _depths(synthesizer, poses[:, :2], height, cell, rng)
    return np.array(images, np.float16), poses[:, :2], depths, places


def _tilt(rng: np.random.Generator) -> Array:
    """Return the error of what is taken for level, and of the heading within a column."""
    return so3.exp(np.radians([TILT_DEG, TILT_DEG, 0.6]) * rng.standard_normal(3))


def _depths(
    synthesizer: DepthSynthesizer, places: Array, height: float, cell: float, rng: np.random.Generator
) -> tuple[NDArray[np.float16], Array]:
    """Return depths (K, J, H, W) f2 around places (K, 2) m, and where they are (K, J, 2)."""
    found, at = [], []
    for place in places:
        near = place + rng.uniform(-1.0, 1.0, (J_NEAR, 2)) * cell / np.sqrt(2.0)
        angles, away = rng.uniform(0.0, 2.0 * np.pi, 3 * J_WRONG), rng.uniform(0.8, 5.0, 3 * J_WRONG)
        wrong = place + away[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        others = places[rng.integers(len(places), size=J_ANYWHERE)] + rng.uniform(-0.5, 0.5, (J_ANYWHERE, 2))
        spots = np.concatenate([near, others, wrong])
        ranges = synthesizer.synthesize_many(np.column_stack([spots, np.full(len(spots), height)]))
        is_free = np.array([np.nanmin(r) > 0.35 if np.isfinite(r).any() else False for r in ranges])
        is_free[: J_NEAR + J_ANYWHERE] = True
        order = np.argsort(~is_free, kind="stable")[: J_NEAR + J_ANYWHERE + J_WRONG]  # those in a wall come last
        found.append(np.minimum(ranges[order], 250.0))
        at.append(spots[order])
    return np.array(found, np.float16), np.array(at)


def _home(seed: int, light: int) -> tuple[Any, ...]:
    """Return the arrays of a home: pictures with furniture, depths of its plan."""
    del light  # every home has lamps of its own
    rng, here = np.random.default_rng([seed, 19]), home(seed, HOME_IMAGES)
    synthesizer = DepthSynthesizer(here.plan, SynthesisParams())
    images = []
    for image, pose in zip(here.images, here.poses, strict=True):
        turn = so3.exp(np.array([0.0, 0.0, float(pose[2])])) @ _tilt(rng)
        images.append(level_view(image, HOME_PANORAMA, turn, synthesizer.camera)[0])
    depths, places = _depths(synthesizer, here.poses[:, :2], HOME_HEIGHT, 0.25, rng)
    return np.array(images, np.float16), here.poses[:, :2], depths, places
