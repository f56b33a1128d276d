"""Maps from files: what is written comes back, what is damaged is refused in one line."""

from __future__ import annotations

import struct
import time
from contextlib import nullcontext
from pathlib import Path

import laspy
import numpy as np
import pytest

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.las import read_header, read_las
from mcl_depth.geometry.mesh import mesh_from_faces, sample_surface
from mcl_depth.geometry.pcd import read_pcd
from mcl_depth.geometry.ply import read_ply

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
    "d.las": las()[:96] + struct.pack("<I", 2**32 - 1) + las()[100:],  # where the points begin
}


@pytest.mark.slow
def test_points_come_back(tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).write_bytes(FILES[name])
        np.testing.assert_allclose(read_geometry(tmp_path / name).points, POINTS, atol=1e-6)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).write_bytes(FILES[name][:-14])
        with pytest.raises(ValueError, match=rf"{name}: .*expected.*found"):
            read_geometry(tmp_path / name)


def test_an_absurd_count_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    for name in ABSURD:
        (tmp_path / name).write_bytes(ABSURD[name])
        with pytest.raises(ValueError, match=r"expected.*found"):
            read_geometry(tmp_path / name)
    (tmp_path / "e.las").write_bytes(las())
    assert read_header(tmp_path / "e.las").point_count == 3


def test_a_pcd_holds_numbers_of_any_size_beside_the_points(tmp_path: Path) -> None:
    kinds = ["f8", "f4", "i2", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"]
    names = ["x", "y", "z", *(f"more{k}" for k in range(8))]
    rows = np.zeros(3, np.dtype([(name, f"<{kind}") for name, kind in zip(names, kinds, strict=True)]))
    rows["x"], rows["y"], rows["z"] = POINTS[:, 0], POINTS[:, 1], [1, -3, 7]
    head = f"FIELDS {' '.join(names)}\nSIZE {' '.join(kind[1] for kind in kinds)}\n"
    head += f"TYPE {' '.join(kind[0].upper() for kind in kinds)}\nWIDTH 3\nHEIGHT 1\nDATA binary\n"
    (tmp_path / "a.pcd").write_bytes(head.encode() + rows.tobytes())
    np.testing.assert_array_equal(read_geometry(tmp_path / "a.pcd").points[:, 2], [1, -3, 7])
    (tmp_path / "b.pcd").write_bytes(pcd("binary").replace(b"SIZE 4", b"SIZE 2"))
    with pytest.raises(ValueError, match="of known size"):
        read_geometry(tmp_path / "b.pcd")


def test_millimeters_are_refused_and_a_wide_map_is_not() -> None:
    rng = np.random.default_rng(0)
    room = rng.uniform(-4000, 4000, (500, 3))
    with pytest.raises(ValueError, match="looks like millimetres"):
        cloud_from_points(room)
    assert cloud_from_points(room / 1000).warnings == ()
    road = rng.uniform((0, 0, 0), (3000, 2, 0.1), (60_000, 3))  # ten points a square metre
    assert len(cloud_from_points(road).points) == 60_000


@pytest.mark.dds
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


def rows_of(form, rows, kinds):
    """Rows of numbers in a form of PLY; `kinds` of NumPy, one a number."""
    if form == "ascii":
        return "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    order = ">" if "big" in form else "<"
    return b"".join(np.array(n, order + kind).tobytes() for row in rows for n, kind in zip(row, kinds, strict=False))


HEAD = """comment made by hand
element camera 1
property int id
element vertex 5
property double z
property uchar red
property double x
property double y
element face 3
property uchar flags
property list uchar int vertex_index
property list uchar float texcoord
end_header
"""


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_holds_properties_in_any_order_and_polygons_beside_other_lists(tmp_path: Path, form: str) -> None:
    vertices = [(9.5, 200, 1.0, 2.0), (0.0, 1, 4.0, 0.5), (1.0, 2, -3.0, 5.0), (2.0, 3, 7.0, 7.0), (0.5, 4, 0.0, 3.0)]
    rows = [(7, 4, 0, 1, 2, 3, 1, 0.5), (8, 3, 2, 3, 4, 0), (9, 2, 1, 0, 2, 0.5, -1.5)]  # flags, corners, texcoord
    kinds = [
        ("u1", "u1", "i4", "i4", "i4", "i4", "u1", "f4"),
        ("u1", "u1", *["i4"] * 3, "u1"),
        ("u1", "u1", "i4", "i4", "u1", "f4", "f4"),
    ]
    body = rows_of(form, [(77,)], ["i4"]) + rows_of(form, vertices, ["f8", "u1", "f8", "f8"])
    body += b"".join(rows_of(form, [row], kind) for row, kind in zip(rows, kinds, strict=True))
    head = f"ply\nformat {form} 1.0\n{HEAD}"
    (tmp_path / "m.ply").write_bytes(head.encode() + body)
    mesh = read_geometry(tmp_path / "m.ply")
    np.testing.assert_allclose(mesh.points, [(x, y, z) for z, _, x, y in vertices])
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [2, 3, 4]]
    for name in ("texcoord", "corners"):
        (tmp_path / "m.ply").write_bytes(head.replace("vertex_index", name).encode() + body)
        with pytest.raises(ValueError, match=f"header: face: expected one list vertex_indices, found {name}"):
            read_ply(tmp_path / "m.ply")
    (tmp_path / "m.ply").write_bytes(head.replace("face 3", "face 4").encode() + body)
    with pytest.raises(ValueError, match="face 3: expected up to 255 corners within the file"):
        read_ply(tmp_path / "m.ply")


@pytest.mark.parametrize(("count", "is_refused"), [(255, False), (256, True), (-1, True)])
def test_a_face_has_up_to_255_corners(tmp_path: Path, count: int, is_refused: bool) -> None:
    head = ply("binary_little_endian", faces=True)[:-13].replace(b"list uchar", b"list short")
    (tmp_path / "a.ply").write_bytes(head + struct.pack("<h", count) + bytes(4 * 256))
    with pytest.raises(ValueError, match="face 0: expected up to 255 corners") if is_refused else nullcontext():
        assert len(read_ply(tmp_path / "a.ply")[1]) == count - 2


def test_a_mesh_of_triangles_alone_is_read_at_once(tmp_path):
    corners = np.random.default_rng(5).integers(0, 3, (100_000, 3)).astype("<i4")
    rows = np.rec.fromarrays([np.full(len(corners), 3, np.uint8), corners], [("number", "u1"), ("corners", "<i4", 3)])
    head = ply("binary_little_endian", faces=True)[:-13].replace(b"face 1", b"face 100000")
    (tmp_path / "a.ply").write_bytes(head + rows.tobytes())
    begun = time.process_time()
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply")[1], corners)
    assert time.process_time() - begun < 0.1  # 0.3 s one by one
    (tmp_path / "a.ply").write_bytes(head + rows.tobytes()[:-1])
    with pytest.raises(ValueError, match="face 99999: expected up to"):
        read_ply(tmp_path / "a.ply")


def test_text_beyond_its_last_row_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(FILES["a.ply"] + b"7\n")
    with pytest.raises(ValueError, match="body: expected 9 numbers, found 10"):
        read_ply(tmp_path / "a.ply")


def test_rows_that_are_not_corners_alone_are_not_read_and_the_points_are(tmp_path: Path) -> None:
    head, _, _ = ply("binary_little_endian", faces=True).partition(b"end_header\n")
    body = rows_of("little", POINTS, ["f4"] * 3) + rows_of("little", [(3, 0, 1, 2)], ["u1", "i4", "i4", "i4"])
    (tmp_path / "a.ply").write_bytes(head.replace(b"element face", b"element tristrips") + b"end_header\n" + body)
    found = read_geometry(tmp_path / "a.ply")
    assert not found.is_mesh
    np.testing.assert_allclose(found.points, POINTS)


@pytest.mark.parametrize("form", ["ascii", "binary"])
def test_a_pcd_holds_other_fields_between_the_coordinates(tmp_path: Path, form: str) -> None:
    head = "# remark\nVERSION .7\nFIELDS z normal x intensity y\nSIZE 4 4 8 2 4\nTYPE F F F U F\nCOUNT 1 3 1 1 1\n"
    head += "WIDTH 3\nHEIGHT 1\n"
    kind = np.dtype([("z", "<f4"), ("n", "<f4", 3), ("x", "<f8"), ("i", "<u2"), ("y", "<f4")])
    table = np.zeros(3, kind)
    table["x"], table["y"], table["z"] = POINTS.T
    table["n"], table["i"] = 0.25, 9
    body = table.tobytes()
    if form == "ascii":
        body = "\n".join(f"{z} 0.25 0.25 0.25 {x} 9 {y}" for x, y, z in POINTS).encode()
    (tmp_path / "a.pcd").write_bytes(head.encode() + f"DATA {form}\n".encode() + body)
    np.testing.assert_allclose(read_geometry(tmp_path / "a.pcd").points, POINTS, atol=1e-6)


@pytest.mark.parametrize(("num_lonely", "extent", "is_refused"), [(60, 1001, True), (50, 1001, False)])
def test_points_alone_in_their_cubic_metre_are_no_map(num_lonely, extent, is_refused) -> None:
    lonely = np.column_stack([np.linspace(0.0, extent, num_lonely), np.zeros(num_lonely), np.zeros(num_lonely)])
    close = np.full((100 - num_lonely, 3), 0.5) + np.array([0.0, 9.0, 0.0])
    if is_refused:
        with pytest.raises(ValueError, match="looks like millimetres"):
            cloud_from_points(np.concatenate([lonely, close]))
        assert len(cloud_from_points(np.concatenate([lonely, close])[1:]).points) == 99  # too few to tell
    else:
        assert len(cloud_from_points(np.concatenate([lonely, close])).points) == 100


@pytest.mark.parametrize(
    ("far", "width", "is_refused"), [(99e3, 10.0, False), (101e3, 10.0, True), (101e3, 6e3, False)]
)
def test_a_map_may_be_as_far_away_as_twenty_times_its_width(far, width, is_refused) -> None:
    side = np.linspace(0.0, width, 50)
    points = np.column_stack([side - far, side, np.zeros(50)])
    far_off = pytest.raises(ValueError, match="expected coordinates within 100000 m of the origin, found 101000")
    with far_off if is_refused else nullcontext():
        assert len(cloud_from_points(points).points) == 50


def test_points_of_a_surface_are_spread_by_area() -> None:
    corners = np.array([[0, 0, 0], [4, 0, 0], [0, 2, 0], [0, 0, 5], [1, 0, 5], [0, 1, 5]], float)
    mesh = mesh_from_faces(corners, np.array([[0, 1, 2], [3, 4, 5], [0, 1, 1]]), "two")
    assert mesh.warnings == ("two: 1 of 3 faces have no finite area and are left out",)
    points = sample_surface(mesh, 0.05).points
    assert len(points) == 1800
    is_low = points[:, 2] < 1.0
    assert is_low.sum() == pytest.approx(4.0 / 0.05**2, abs=1)
    np.testing.assert_allclose(points[is_low].mean(axis=0), corners[:3].mean(axis=0), atol=0.05)
    assert np.all(points[is_low][:, 0] / 4 + points[is_low][:, 1] / 2 <= 1 + 1e-6)
    with pytest.raises(ValueError, match="expected at most 50000000 samples"):
        sample_surface(mesh, 1e-4)


def test_a_header_ends_within_64_kib(tmp_path: Path) -> None:
    first, rest = FILES["a.pcd"].split(b"\n", 1)
    for length, is_read in ((65_000, True), (66_000, False)):
        (tmp_path / "a.pcd").write_bytes(first + b"\n#" + b" " * length + b"\n" + rest)
        with nullcontext() if is_read else pytest.raises(ValueError, match="header"):
            assert len(read_pcd(tmp_path / "a.pcd")) == 3


def write_lying_tile(path: Path, *lies: tuple[str, int, int, int]) -> None:
    """Write a packed tile of 200 points in one chunk, then say something else of it."""
    tile = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    tile.x, tile.y, tile.z = np.random.default_rng(1).uniform(-30, 30, (3, 200))
    tile.write(path)
    data = bytearray(path.read_bytes())
    points = int.from_bytes(data[96:100], "little")
    record = data.find(b"laszip encoded") + 52
    starts = {"header": 0, "points": points, "record": record, "chunks": int.from_bytes(data[points:][:8], "little")}
    for place, offset, width, value in lies:
        struct.pack_into({2: "<H", 4: "<I", 8: "<Q"}[width], data, starts[place] + offset, value)
    path.write_bytes(data)


ATTACKS = {  # on a tile of 200 points: where, how wide, what
    "a billion chunks, of which lazrs aborts": ("chunks", 4, 4, 2**31 - 1),
    "one point more": ("header", 107, 4, 201),
    "no items, of which lazrs panics": ("record", 32, 2, 0),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_a_packed_tile_that_lies_of_its_chunks_ends_no_process_but_its_reader(tmp_path: Path, name: str) -> None:
    write_lying_tile(tmp_path / "a.laz", ATTACKS[name])
    with pytest.raises(ValueError, match=r"a\.laz: .*expected.*found") as caught:
        read_las(tmp_path / "a.laz")
    assert "\n" not in str(caught.value)


def test_one_number_that_is_no_coordinate_is_named(tmp_path: Path) -> None:
    points = np.random.default_rng(3).uniform(-5.0, 5.0, (300, 3))
    for number in (1e20, -1e300):
        points[7, 1] = number
        np.save(tmp_path / "far.npy", points)
        with pytest.raises(ValueError, match=r"far.npy: point 7: expected coordinates up to 1e\+10, found"):
            read_geometry(tmp_path / "far.npy")
