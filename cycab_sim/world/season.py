"""The same world on another day: other cars along the kerbs, trees in other leaves or bare; no building changes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from cycab_sim.params import SeasonParams
from cycab_sim.world import finishes, furniture
from cycab_sim.world.mesh import Mesh, MeshBuilder, joined
from cycab_sim.world.texture import kernels as k
from sphere_nav.geometry.arrays import Array, Flags, Integers

OCCUPIED, SHIFT, REVERSED = 0.55, 0.4, 0.3  # share of the slots, m along them, share of the cars that look back
REACH = 3.0  # a lump of leaves belongs to the trunk that is at most this far, m
CROWN = 0.7  # and begins at most this far below its top, m
TWIGS = 26  # of a lump
THICK_BRANCH, THICK_TWIG = 0.05, 0.018  # half their width, m
AUTUMN = np.array([[0.42, 0.26, 0.05], [0.36, 0.14, 0.04], [0.26, 0.17, 0.07], [0.20, 0.19, 0.05]])  # reflectances


def change_season(mesh: Mesh, params: SeasonParams, seed: int) -> Mesh:
    """Return the mesh of a season; the same object where nothing changes. Lamps and slots stay."""
    if params.parked and len(mesh.slots):
        mesh = park(mesh, seed, params.parked)
    if params.leaves == "yellow":
        return _with_autumn_leaves(mesh, seed)
    return _with_bare_trees(mesh, seed) if params.leaves == "none" else mesh


def park(mesh: Mesh, seed: int, number: int) -> Mesh:
    """Take the parked cars away and put others into slots drawn by a number."""
    rng = np.random.default_rng([seed, number, 91])
    builder = MeshBuilder(rng, is_clutter=True, is_parked=True)
    for slot in mesh.slots:
        if rng.random() < OCCUPIED:
            turn = (np.pi if rng.random() < REVERSED else 0.0) + rng.normal(0.0, 0.02)
            furniture.add_car(builder.within(slot).at(rng.uniform(-SHIFT, SHIFT), 0.0, turn))
    left = _with_triangles(mesh, ~mesh.is_parked[mesh.surface_of])
    return joined([left, builder.build()]) if builder.num_surfaces else left


def _with_autumn_leaves(mesh: Mesh, seed: int) -> Mesh:
    """Return the mesh with leaves of the colours of autumn, each lump of its own."""
    is_leaf = mesh.kinds[:, 0] == k.FOLIAGE
    rng = np.random.default_rng([seed, 92])
    tips = AUTUMN[rng.integers(0, len(AUTUMN), is_leaf.sum())] * rng.uniform(0.8, 1.2, (is_leaf.sum(), 1))
    colors = mesh.colors.copy()
    colors[is_leaf] = np.stack([0.4 * tips, tips], axis=1)
    return replace(mesh, colors=colors)


def _with_bare_trees(mesh: Mesh, seed: int) -> Mesh:
    """Return the mesh with a branch and twigs instead of each lump of leaves on a trunk; hedges are evergreen."""
    is_trunk = mesh.kinds[:, 0] == k.BARK
    if not is_trunk.any():
        return mesh
    trunks = -np.einsum("nji,nj->ni", mesh.frames[is_trunk, :, :3], mesh.frames[is_trunk, :, 3])  # their feet (N, 3)
    tops = np.array([mesh.triangles[mesh.surface_of == s][..., 2].max() for s in np.flatnonzero(is_trunk)])
    keep = np.ones(len(mesh.triangles), bool)
    kinds, colors, params = mesh.kinds.copy(), mesh.colors.copy(), mesh.params.copy()
    made, owners = [], []
    rng = np.random.default_rng([seed, 93])
    for s in np.flatnonzero(mesh.kinds[:, 0] == k.FOLIAGE):
        members = np.flatnonzero(mesh.surface_of == s)
        points = mesh.triangles[members].reshape(-1, 3).astype(np.float64)
        center, radius = points.mean(axis=0), float(points.std(axis=0).mean()) * np.sqrt(3.0)
        away = np.hypot(*(trunks[:, :2] - center[:2]).T)
        tree = int(np.argmin(away))
        if away[tree] > REACH or center[2] < tops[tree] - CROWN:
            continue
        keep[members] = False
        faces = _branches(np.array([*trunks[tree, :2], tops[tree] - 0.3]), center, radius, rng)
        made.append(faces)
        owners.append(np.full(len(faces), s))
        kinds[s, 0], colors[s] = k.BARK, (finishes.BARK.color, finishes.BARK.second)
        params[s], params[s, 0] = 0.0, finishes.BARK.params[0]
    changed = _with_triangles(replace(mesh, kinds=kinds, colors=colors, params=params), keep)
    return _with_added(changed, np.concatenate(made), np.concatenate(owners)) if made else changed


def _branches(foot: Array, center: Array, radius: float, rng: np.random.Generator) -> Array:
    """Return a branch from a trunk to the middle of a crown's lump, and twigs from it outward, (F, 3, 3) m."""
    out = rng.normal((0.0, 0.0, 0.5), size=(TWIGS, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    starts = foot + rng.uniform(0.45, 1.0, (TWIGS, 1)) * (center - foot)
    ends = center + out * radius * rng.uniform(0.6, 1.15, (TWIGS, 1))
    starts, ends = np.concatenate([foot[None], starts]), np.concatenate([center[None], ends])
    return _rods(starts, ends, np.array([THICK_BRANCH, *[THICK_TWIG] * TWIGS]))


def _rods(starts: Array, ends: Array, half: Array) -> Array:
    """Return the three long sides of thin rods (N, 3) to (N, 3) that end in points, half (N,) m wide: (3 N, 3, 3) m."""
    along = ends - starts
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    x = np.cross(along, np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    x *= half[:, None] / np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(along, x)
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    ring = starts[:, None] + np.cos(angles)[:, None] * x[:, None] + np.sin(angles)[:, None] * y[:, None]
    tips = np.broadcast_to(ends[:, None], ring.shape)
    return np.stack([ring, np.roll(ring, -1, axis=1), tips], axis=2).reshape(-1, 3, 3)


def _with_triangles(mesh: Mesh, keep: Flags) -> Mesh:
    """Return the mesh with those triangles alone; surfaces keep their numbers."""
    kept = {name: getattr(mesh, name)[keep] for name in ("triangles", "normals", "surface_of")}
    return replace(mesh, **kept)


def _with_added(mesh: Mesh, faces: Array, surfaces: Integers) -> Mesh:
    """Return the mesh with more triangles (F, 3, 3) m of surfaces (F,) that it has."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    more = {"triangles": faces, "normals": normals, "surface_of": surfaces}
    columns = {item.name: getattr(mesh, item.name) for item in fields(Mesh)}
    return Mesh(**columns | {n: np.concatenate([columns[n], v.astype(columns[n].dtype)]) for n, v in more.items()})
