"""The moving part of the world for the ray caster: its triangles where they are now, behind those that stand still."""

from __future__ import annotations

import ctypes

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from cycab_sim.rendering.casting.embree import PacketScene
from cycab_sim.world.mesh import Mesh, joined
from cycab_sim.world.traffic import kernels
from cycab_sim.world.traffic.traffic import Traffic

Floats = NDArray[np.float32]


class MovingScene:
    """`mesh` is the whole world, still triangles first; its normals and frames follow what moves."""

    def __init__(self, still: Mesh, traffic: Traffic, library: ctypes.CDLL | None) -> None:
        self.mesh = joined([still, traffic.mesh])
        self.first = len(still.triangles)
        self.triangles = traffic.mesh.triangles.copy()
        self._moved = self.triangles, self.mesh.normals[self.first :], self.mesh.frames[len(still.frames) :]
        self._local = traffic.mesh.triangles, traffic.mesh.normals, traffic.mesh.frames
        self._parts = traffic.part_of_triangle, traffic.part_of_surface
        self._packets = PacketScene(library, self.triangles, is_moving=True) if library is not None else None
        self.move(traffic.poses(0))

    def move(self, T_world_part: NDArray[np.float64]) -> None:
        """Put every part (P, 4, 4) where it is now."""
        kernels.place_parts(T_world_part, *self._parts, self._local, self._moved)
        if self._packets is not None:
            self._packets.move(self.triangles)
            return
        self._scene = EmbreeScene(robust=True)
        self._keep = TriangleMesh(self._scene, self.triangles)
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree, not thread-safe

    def cast_nearer(
        self, origin: NDArray[np.float64], rays: Floats, triangles: NDArray[np.int32], ranges: Floats
    ) -> None:
        """Overwrite what rays (N, 3) have met where something that moves is nearer."""
        if self._packets is not None:
            self._packets.cast_nearer(origin, rays, self.first, triangles, ranges)
            return
        starts = np.broadcast_to(origin.astype(np.float32), rays.shape).copy()
        found = self._scene.run(starts, rays, query="INTERSECT", output=1)
        is_nearer = (found["primID"] >= 0) & (found["tfar"] < ranges)
        triangles[is_nearer] = self.first + found["primID"][is_nearer]
        ranges[is_nearer] = found["tfar"][is_nearer]
