"""The Embree library that embreex brings, by its C interface: packets of coherent rays against triangles."""

from __future__ import annotations

import ctypes
import re
from functools import cache
from pathlib import Path

import embreex.rtcore_scene  # noqa: F401  loads the library
import numpy as np
from numpy.typing import NDArray

from cycab_sim.rendering import kernels
from cycab_sim.world.mesh import Mesh, joined
from cycab_sim.world.traffic.traffic import Traffic
from sphere_nav.geometry.arrays import Array, Floats

MAPS = Path("/proc/self/maps")
DYNAMIC, ROBUST = 1, 4  # flags of a scene
LOW_QUALITY, HIGH_QUALITY, TRIANGLES = 0, 2, 0
INDICES, VERTICES = (0, 0x5003), (1, 0x9003)  # kinds of buffers and their formats: 3 x u4, 3 x f4
COHERENT = 1 << 16


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = (
        ("flags", ctypes.c_int),
        ("features", ctypes.c_uint),
        ("callbacks", ctypes.c_void_p * 3),
        ("spare", ctypes.c_float * 4),
    )


class PacketScene:
    """Triangles (T, 3, 3) f32 m; `cast` finds the first that rays meet. Threads may share it.

    Those of a scene that is moving can be put elsewhere, while nobody casts. They are numbered from `first` on.
    """

    def __init__(self, triangles: Floats, first: int = 0, is_moving: bool = False) -> None:
        library, device = load_library()
        self._first = first
        self._vertices = np.zeros((3 * len(triangles) + 2, 3), np.float32)  # read 16 bytes at a time
        self._vertices[:-2] = triangles.reshape(-1, 3)
        self._indices = np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3)
        scene = ctypes.c_void_p(library.rtcNewScene(device))
        library.rtcSetSceneFlags(scene, ROBUST | (DYNAMIC if is_moving else 0))
        library.rtcSetSceneBuildQuality(scene, LOW_QUALITY if is_moving else HIGH_QUALITY)
        geometry = ctypes.c_void_p(library.rtcNewGeometry(device, TRIANGLES))
        share = library.rtcSetSharedGeometryBuffer
        for (kind, form), data, count in (
            (VERTICES, self._vertices, len(self._vertices) - 2),
            (INDICES, self._indices, len(self._indices)),
        ):
            size = [ctypes.c_size_t(number) for number in (0, 12, count)]
            share(geometry, kind, 0, form, ctypes.c_void_p(data.ctypes.data), *size)
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(scene, geometry)
        library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(scene)
        self._library, self._scene, self._geometry = library, scene, geometry
        self._arguments = _Arguments(COHERENT, 0xFFFFFFFF), _Arguments(0, 0xFFFFFFFF)  # from one point, from many
        address = ctypes.cast(library.rtcIntersect8, ctypes.c_void_p).value
        self._intersect = kernels.PacketFunction(address)

    def __del__(self) -> None:
        if hasattr(self, "_scene"):
            self._library.rtcReleaseScene(self._scene)

    def move(self, triangles: Floats) -> None:
        """Put the triangles (T, 3, 3) elsewhere."""
        self._vertices[:-2] = triangles.reshape(-1, 3)
        self._library.rtcUpdateGeometryBuffer(self._geometry, VERTICES[0], 0)
        self._library.rtcCommitGeometry(self._geometry)
        self._library.rtcCommitScene(self._scene)

    def cast(self, origins: Array | Floats, rays: Floats) -> tuple[NDArray[np.int32], Floats]:
        """Return the number (N,) of the first triangle, -1: none, and its range (N,) m, along unit rays (N, 3).

        They begin at one point (3,) m, or at a point each (N, 3).
        """
        triangles, ranges = np.full(len(rays), -1, np.int32), np.full(len(rays), np.inf, np.float32)
        self.cast_nearer(origins, rays, triangles, ranges)
        return triangles, ranges

    def cast_nearer(self, origins: Array | Floats, rays: Floats, triangles: NDArray[np.int32], ranges: Floats) -> None:
        """Overwrite what was met (N,) where a triangle of this scene is nearer than `ranges`."""
        starts = np.ascontiguousarray(origins, dtype=np.float32).reshape(-1, 3)
        scene = self._intersect, self._scene.value, ctypes.addressof(self._arguments[len(starts) > 1])
        kernels.cast_packets(*scene, starts, rays, self._first, triangles, ranges)


class MovingScene:
    """What moves, for the ray caster, behind what stands still.

    `mesh` is the whole world, still triangles first; its normals and frames follow what moves.
    """

    def __init__(self, still: Mesh, traffic: Traffic) -> None:
        self.mesh, first = joined([still, traffic.mesh]), len(still.triangles)
        self._traffic = traffic
        self._normals, self._frames = self.mesh.normals[first:], self.mesh.frames[len(still.frames) :]
        self.scene = PacketScene(traffic.mesh.triangles, first, is_moving=True)
        self.move(traffic.poses(0))

    def move(self, T_world_part: Array) -> None:
        """Put every part (P, 4, 4) where it is now."""
        local, T = self._traffic.mesh, T_world_part.astype(np.float32)
        to_world, to_part = T[self._traffic.part_of_triangle], np.linalg.inv(T)[self._traffic.part_of_surface]
        R = to_world[:, :3, :3]
        self._normals[:] = np.einsum("nij,nj->ni", R, local.normals)
        self._frames[:] = local.frames[:, :, :3] @ to_part[:, :3]
        self._frames[:, :, 3] += local.frames[:, :, 3]
        self.scene.move(local.triangles @ R.swapaxes(1, 2) + to_world[:, None, :3, 3])


@cache
def load_library() -> tuple[ctypes.CDLL, ctypes.c_void_p]:
    """Return the Embree 4 that embreex has loaded, and a device of it."""
    found = re.search(r"(/\S*libembree4\S*\.so\S*)", MAPS.read_text(encoding="utf-8", errors="replace"))
    if found is None:
        raise ImportError("embreex: expected Embree 4 as a shared library, found none")
    library = ctypes.CDLL(found.group(1))
    for name in ("rtcNewDevice", "rtcNewScene", "rtcNewGeometry"):
        getattr(library, name).restype = ctypes.c_void_p
    return library, ctypes.c_void_p(library.rtcNewDevice(None))
