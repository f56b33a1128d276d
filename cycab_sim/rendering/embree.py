"""The Embree library that embreex brings, by its C interface: packets of coherent rays against triangles."""

from __future__ import annotations

import ctypes
import re
from functools import cache
from pathlib import Path

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
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
MIN_VERSION, VERSION, NATIVE_8 = 40000, 0, 33


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = (
        ("flags", ctypes.c_int),
        ("features", ctypes.c_uint),
        ("callbacks", ctypes.c_void_p * 3),
        ("spare", ctypes.c_float * 4),
    )


class PacketScene:
    """Triangles (T, 3, 3) f32 m; `cast` finds the first that rays from one point meet. Threads may share it.

    Those of a scene that is moving can be put elsewhere, while nobody casts.
    """

    def __init__(self, library: ctypes.CDLL, triangles: Floats, is_moving: bool = False) -> None:
        device = _device(library)
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
        self._arguments = _Arguments(COHERENT, 0xFFFFFFFF)
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

    def cast(
        self,
        origin: Array,
        rays: Floats,
        triangles: NDArray[np.int32],
        ranges: Floats,
    ) -> None:
        """Write the number (N,) of the first triangle, -1: none, and its range (N,) m along unit rays (N, 3)."""
        triangles[:], ranges[:] = -1, np.inf
        self.cast_nearer(origin, rays, 0, triangles, ranges)

    def cast_nearer(
        self,
        origin: Array,
        rays: Floats,
        first_number: int,
        triangles: NDArray[np.int32],
        ranges: Floats,
    ) -> None:
        """Overwrite what was met (N,) where a triangle of this scene is nearer than `ranges`, first_number added."""
        arguments = ctypes.addressof(self._arguments)
        kernels.cast_packets(
            self._intersect, self._scene.value, arguments, origin, rays, first_number, triangles, ranges
        )


class MovingScene:
    """What moves, for the ray caster, behind what stands still.

    `mesh` is the whole world, still triangles first; its normals and frames follow what moves.
    """

    def __init__(self, still: Mesh, traffic: Traffic, library: ctypes.CDLL | None) -> None:
        self.mesh = joined([still, traffic.mesh])
        self.first = len(still.triangles)
        self.triangles = traffic.mesh.triangles.copy()
        self._moved = self.triangles, self.mesh.normals[self.first :], self.mesh.frames[len(still.frames) :]
        self._local = traffic.mesh.triangles, traffic.mesh.normals, traffic.mesh.frames
        self._parts = traffic.part_of_triangle, traffic.part_of_surface
        self._packets = PacketScene(library, self.triangles, is_moving=True) if library is not None else None
        self.move(traffic.poses(0))

    def move(self, T_world_part: Array) -> None:
        """Put every part (P, 4, 4) where it is now."""
        kernels.place_parts(T_world_part, *self._parts, self._local, self._moved)
        if self._packets is not None:
            self._packets.move(self.triangles)
            return
        self._scene = EmbreeScene(robust=True)
        self._keep = TriangleMesh(self._scene, self.triangles)
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree, not thread-safe

    def cast_nearer(
        self,
        origin: Array,
        rays: Floats,
        triangles: NDArray[np.int32],
        ranges: Floats,
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


@cache
def find_library() -> ctypes.CDLL | None:
    """Return the Embree 4 that is loaded; None where it cannot be found or cannot take packets of eight."""
    text = MAPS.read_text(encoding="utf-8", errors="replace") if MAPS.exists() else ""
    found = re.search(r"(/\S*libembree4\S*\.so\S*)", text)
    if found is None:
        return None
    library = ctypes.CDLL(found.group(1))
    for name in ("rtcNewDevice", "rtcNewScene", "rtcNewGeometry"):
        getattr(library, name).restype = ctypes.c_void_p
    library.rtcGetDeviceProperty.restype = ctypes.c_ssize_t
    device = _device(library)
    version, has_eight = (library.rtcGetDeviceProperty(device, number) for number in (VERSION, NATIVE_8))
    return library if version >= MIN_VERSION and has_eight else None


@cache
def _device(library: ctypes.CDLL) -> ctypes.c_void_p:
    return ctypes.c_void_p(library.rtcNewDevice(None))
