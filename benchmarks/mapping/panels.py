"""Rooms in which range cannot be measured everywhere: bare, unlit and repetitive panels among textured ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import CameraRigParams, ImagingParams, LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.imaging import expose
from cycab_sim.sensors.rigs import make_rig, rig_mounts, rig_place
from cycab_sim.world import finishes
from cycab_sim.world.mesh import Finish, Mesh, MeshBuilder
from cycab_sim.world.texture import kernels as k
from sphere_nav.geometry import SE3, Rig, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build

Image = NDArray[np.uint8]

TEXTURED, BARE, UNLIT, REPETITIVE = 0, 1, 2, 3  # classes of surfaces
PANEL_M = 1.3  # width of a wall's panel
CLEAR_M = 0.35  # from the middle of the rig to boxes: the ring's cameras stand 0.3 m from it, and in no solid thing
EFFORT = RenderParams(shadow_texel=0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """What a rig saw of a room, and what is there."""

    rig: Rig
    images: dict[str, Image]
    renderer: Renderer
    T_world_rig: SE3
    kinds: NDArray[np.int8]  # of the triangles

    def truth(self, whole: Spherical, T_rig_sphere: SE3) -> tuple[NDArray[np.float32], NDArray[np.int8]]:
        """Return the range (H, W) m and the class (H, W) of what a sphere on the rig sees."""
        T_world_sphere = self.T_world_rig @ T_rig_sphere
        _, range_m = self.renderer.render(whole, T_world_sphere)
        return range_m, self._kind_at(T_world_sphere.apply(pixel_rays(whole) * range_m[..., None]))

    def _kind_at(self, points: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return the class of the triangle whose plane and box hold each point (H, W, 3)."""
        mesh, found = self.renderer.mesh, np.zeros(points.shape[:2], np.int8)
        for triangle, normal, kind in zip(mesh.triangles, mesh.normals, self.kinds, strict=True):
            if kind == TEXTURED:
                continue
            low, high = triangle.min(axis=0) - 0.01, triangle.max(axis=0) + 0.01
            inside = np.all((points > low) & (points < high), axis=-1)
            inside[inside] = np.abs((points[inside] - triangle[0]) @ normal) < 0.01
            found[inside] = kind
        return found


def make_scene(seed: int, kind: str, width: int, lens: Mapping[str, object] | None = None) -> Scene:
    """Return what a rig of a kind (vertical, ring) sees in the room of a seed; lens: parameters of its cameras."""
    rng = np.random.default_rng([seed, 71])
    mesh, kinds, size, boxes = _room(rng)
    values = {"kind": kind, "size": f"{width * 17 // 32},{width * 17 // 32}"} | dict(lens or {})
    params = build(CameraRigParams, values)
    rig = make_rig(params, seed)
    assert rig is not None
    renderer = Renderer(mesh, EFFORT, LightParams())
    place = rig_place(params)
    lowered = SE3.from_parts(place.rotation, [*place.translation[:2], min(place.translation[2], 0.5 * size[2])])
    T_world_rig = _draw_place(rng, size) @ lowered
    while not _is_free(T_world_rig.translation, boxes, params.baseline):
        T_world_rig = _draw_place(rng, size) @ lowered
    images = {}
    for number, mount in enumerate(rig_mounts(params, ImagingParams(), rig)):
        T_rig_camera = rig.camera(mount.name).T_rig_camera
        levels, _ = renderer.render(mount.camera, T_world_rig @ T_rig_camera)
        images[mount.name] = expose(levels, mount.noise, mount.shot_noise, (seed, 72, number))
    return Scene(rig, images, renderer, T_world_rig, kinds)


def _draw_place(rng: np.random.Generator, size: NDArray[np.float64]) -> SE3:
    x, y = rng.uniform(-0.25, 0.25, 2) * size[:2]
    return SE3.from_planar(float(x), float(y), float(rng.uniform(-3, 3)))


def _is_free(at: NDArray[np.float64], boxes: NDArray[np.float64], height: float) -> bool:
    """Return whether a rig that reaches from `at` (3,) so far down has no box (N, 2, 3: lowest, highest) in its way."""
    apart = np.maximum(np.maximum(boxes[:, 0, :2] - at[:2], at[:2] - boxes[:, 1, :2]), 0.0)
    is_below = boxes[:, 1, 2] < at[2] - height - CLEAR_M
    return bool(np.all(is_below | (np.linalg.norm(apart, axis=1) >= CLEAR_M)))


def _room(rng: np.random.Generator) -> tuple[Mesh, NDArray[np.int8], NDArray[np.float64], NDArray[np.float64]]:
    """Return a furnished room around the origin, the class of each triangle, its sides in m, its boxes (N, 2, 3)."""
    size = np.array([rng.uniform(4, 9), rng.uniform(4, 9), rng.uniform(2.5, 3.4)])
    builder, kinds = MeshBuilder(rng), []

    def add(quad: NDArray[np.float64], finish: Finish, kind: int) -> None:
        builder.panels(quad[None], finish)
        kinds.extend([kind] * 2)

    low, high = -size / 2, size / 2
    low[2], high[2] = 0.0, size[2]
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    for number in range(4):
        a, b = np.array(corners[(number + 1) % 4]), np.array(corners[number])  # seen from inside
        count = int(np.ceil(np.linalg.norm(b - a) / PANEL_M))
        for step in range(count):
            ends = [a + (b - a) * share / count for share in (step, step + 1)]
            quad = np.array([[*ends[0], 0], [*ends[1], 0], [*ends[1], size[2]], [*ends[0], size[2]]])
            add(quad, *_finish(rng))
    (x0, y0), (x1, y1) = corners[0], corners[2]
    floor = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], dtype=np.float64)
    add(floor, finishes.PAVING if rng.random() < 0.5 else finishes.ASPHALT, TEXTURED)
    ceiling = floor[::-1] + np.array([0.0, 0.0, size[2]])
    add(ceiling, *((_bare(rng), BARE) if rng.random() < 0.7 else (finishes.wall(rng), TEXTURED)))
    boxes = []
    for _ in range(5):
        side, height = rng.uniform(0.3, 0.9, 2), rng.uniform(0.4, 1.6)
        at = rng.uniform(low[:2] + 0.1, high[:2] - side - 0.1)
        finish, kind = _finish(rng)
        builder.box([*at, 0.0], [*side, height], finish)
        boxes.append([[*at, 0.0], [*(at + side), height]])
        kinds.extend([kind] * 12)
    return builder.build(), np.array(kinds, np.int8), size, np.array(boxes)


def _finish(rng: np.random.Generator) -> tuple[Finish, int]:
    """Return what a panel is made of, and its class: about half are textured."""
    draw = rng.random()
    if draw < 0.2:
        return _bare(rng), BARE
    if draw < 0.3:
        return Finish(k.PLASTER, (0.004, 0.004, 0.004), (0.002, 0.002, 0.002), (0.15,)), UNLIT
    if draw < 0.45:
        return Finish(
            k.SLATS, finishes.pick(rng, finishes.PLASTERS), (0.1, 0.1, 0.1), (0.0, rng.uniform(0.05, 0.15))
        ), REPETITIVE
    if draw < 0.6:
        return finishes.sign(PANEL_M, 2.0, rng, 3), TEXTURED
    return finishes.wall(rng), TEXTURED


def _bare(rng: np.random.Generator) -> Finish:
    """Return one colour without any texture."""
    color = finishes.pick(rng, finishes.PLASTERS)
    return Finish(k.MARKING, color, color, (0.0, 1.0, 1.0))
