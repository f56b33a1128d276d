"""Maps from files: what is written comes back, what is damaged is refused in one line."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from mcl_depth.geometry.cloud import cloud_from_points, thin_cloud
from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.floor_plan import read_surfaces, rings_of
from mcl_depth.geometry.mesh import TriangleMesh
from mcl_depth.geometry.synthesis import DepthSynthesizer

POINTS = np.array([[0.0, 0.5, 1.0], [1.0, 2.0, 3.0], [-4.0, 5.0, 6.5]])


def ply(form: str, count: int = 3, faces: bool = False) -> bytes:
    head = f"ply\nformat {form} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\n" if faces else ""
    order = ">" if "big" in form else "<"
    rows = POINTS.astype(order + "f4").tobytes() + (struct.pack(order + "B3i", 3, 0, 1, 2) if faces else b"")
    if form == "ascii":
        rows = "\n".join(" ".join(map(str, row)) for row in POINTS).encode() + (b"\n3 0 1 2\n" if faces else b"\n")
    return (head + "end_header\n").encode() + rows


def pcd(form: str, count: int = 3) -> bytes:
    head = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\nPOINTS {count}\n"
    rows = POINTS.astype("<f4").tobytes()
    if form == "ascii":
        rows = "\n".join(" ".join(map(str, row)) for row in POINTS).encode()
    if form == "binary_compressed":  # literal runs only
        plain = POINTS.astype("<f4").T.tobytes()
        packed = b"".join(bytes([len(plain[i : i + 32]) - 1]) + plain[i : i + 32] for i in range(0, len(plain), 32))
        rows = struct.pack("<II", len(packed), len(plain)) + packed
    return f"{head}DATA {form}\n".encode() + rows


def las(count: int = 3, records: int = 0) -> bytes:
    head = bytearray(227)
    head[:4], head[24:26] = b"LASF", bytes([1, 2])
    struct.pack_into("<HI", head, 94, 227, 227)
    struct.pack_into("<I", head, 100, records)
    struct.pack_into("<BHI", head, 104, 0, 20, count)
    struct.pack_into("<6d", head, 131, 0.01, 0.01, 0.01, 0.0, 0.0, 0.0)
    return bytes(head) + b"".join(struct.pack("<3i8x", *map(int, np.rint(row * 100))) for row in POINTS)


FILES = {
    "a.ply": ply("ascii"), "b.ply": ply("binary_little_endian"), "c.ply": ply("binary_big_endian"),
    "a.pcd": pcd("ascii"), "b.pcd": pcd("binary"), "c.pcd": pcd("binary_compressed"), "a.las": las(),
}  # fmt: skip
ABSURD = {
    "a.ply": ply("binary_little_endian", 10**12),
    "a.pcd": pcd("binary", 10**12),
    "b.las": las(10**9),
    "c.las": las(records=10**7),
}


@pytest.mark.parametrize("name", FILES)
def test_points_come_back(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    np.testing.assert_allclose(read_geometry(tmp_path / name).points, POINTS, atol=1e-6)


@pytest.mark.parametrize("name", FILES)
def test_a_truncated_file_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FILES[name][:-14])
    with pytest.raises(ValueError, match=rf"{name}: .*expected.*found"):
        read_geometry(tmp_path / name)


@pytest.mark.parametrize("name", ABSURD)
def test_an_absurd_count_is_refused_before_memory_is_taken(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(ABSURD[name])
    with pytest.raises(ValueError, match=r"expected.*found"):
        read_geometry(tmp_path / name)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_with_faces_is_a_mesh(tmp_path: Path, form: str) -> None:
    (tmp_path / "m.ply").write_bytes(ply(form, faces=True))
    found = read_geometry(tmp_path / "m.ply")
    assert isinstance(found, TriangleMesh)
    assert found.triangles.shape == (1, 3)


def test_arrays(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POINTS)
    np.testing.assert_allclose(read_geometry(tmp_path / "a.npy").points, POINTS)
    np.save(tmp_path / "b.npy", POINTS[:, :2])
    with pytest.raises(ValueError, match="expected numbers of shape"):
        read_geometry(tmp_path / "b.npy")


def test_points_that_are_not_finite_are_counted() -> None:
    cloud = cloud_from_points(np.vstack([POINTS, [[np.nan, 0, 0]]]))
    assert len(cloud) == 3
    assert "1 of 4 points" in cloud.warnings[0]


def test_an_empty_cloud_is_refused() -> None:
    with pytest.raises(ValueError, match="expected at least one finite point"):
        cloud_from_points(np.zeros((0, 3)))


def test_millimetres_are_refused_and_a_wide_map_is_not() -> None:
    rng = np.random.default_rng(0)
    room = rng.uniform(-4000, 4000, (500, 3))
    with pytest.raises(ValueError, match="looks like millimetres"):
        cloud_from_points(room)
    assert cloud_from_points(room / 1000).warnings == ()
    road = rng.uniform((0, 0, 0), (3000, 2, 0.1), (60_000, 3))  # ten points a square metre
    assert len(cloud_from_points(road)) == 60_000


def test_a_packed_tile_is_read_and_one_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    points = np.random.default_rng(1).uniform(-50, 50, (2000, 3))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    tile = laspy.LasData(header)
    tile.x, tile.y, tile.z = points.T
    tile.write(tmp_path / "a.laz")
    np.testing.assert_allclose(read_geometry(tmp_path / "a.laz").points, points, atol=1e-3)
    data = (tmp_path / "a.laz").read_bytes()
    (tmp_path / "b.laz").write_bytes(data[: len(data) // 2])
    with pytest.raises(ValueError, match=r"b\.laz: .*expected"):
        read_geometry(tmp_path / "b.laz")


def test_thinning_keeps_one_point_a_cube() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(8) * 0.1] * 3), axis=-1).reshape(-1, 3) + 0.01
    assert len(thin_cloud(cloud_from_points(grid), 0.2)) == 4**3


def test_a_floor_plan_has_its_door_cut_out(tmp_path: Path) -> None:
    corners = [(0, 0), (4, 0), (4, 3), (0, 3)]
    rows = ["kind,complete_room,x0_m,y0_m,x1_m,y1_m,z_bottom_m,z_top_m"]
    rows += [
        f"wall,a,{x0},{y0},{x1},{y1},0,2.5"
        for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    (tmp_path / "plan.csv").write_text("\n".join([*rows, "door,a,4,1,4,2,0,2"]) + "\n")
    (ring,) = rings_of([surface for surface in read_surfaces(tmp_path / "plan.csv") if surface.kind == "wall"])
    np.testing.assert_array_equal(ring, corners)
    mesh = read_geometry(tmp_path / "plan.csv")
    found = DepthSynthesizer(mesh).synthesize_many([(2.0, 1.5, 1.2)])[0]
    row = found[found.shape[0] // 2]
    assert np.isnan(row[90])  # through the door
    np.testing.assert_allclose(row[[0, 45]], [2.0, 1.5], atol=0.01)


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo.ply")
    (tmp_path / "endless.npy").symlink_to("/dev/zero")
    for name, found in (("fifo.ply", "a FIFO"), ("endless.npy", "no regular file"), ("none.pcd", "no such file")):
        with pytest.raises(ValueError, match=f"{name}: expected a map .*, found {found}"):
            read_geometry(tmp_path / name)


def test_an_archive_is_no_array(tmp_path):
    with (tmp_path / "zip.npy").open("wb") as file:
        np.savez(file, points=np.zeros((4, 3)))
    with pytest.raises(ValueError, match=r"zip\.npy: expected an array \(N, 3\), found a file that is none"):
        read_geometry(tmp_path / "zip.npy")


def test_faces_that_lie_about_their_corners(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int i\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
    for face in ("4 0 1 2", "2 0 1 2", "-1 0 1 2", "3 0 1 99999999999999999999"):
        (tmp_path / "lie.ply").write_text(head + face + "\n")
        with pytest.raises(ValueError, match=r"lie\.ply"):
            read_geometry(tmp_path / "lie.ply")


def test_points_beyond_any_place_on_earth(tmp_path):
    for far in (1e8, 1e30, 1e300):
        np.save(tmp_path / "far.npy", np.array([[0.0, 0.0, 0.0], [far, 0.0, 0.0], [0.0, -far, 0.0]]))
        with pytest.raises(ValueError, match="expected coordinates within"):
            read_geometry(tmp_path / "far.npy")
