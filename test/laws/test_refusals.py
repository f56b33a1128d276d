"""What nobody means is refused in one line that says what was expected: of each kind of value, by its door."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sphere_nav.geometry import SE3, DoubleSphere, Omni, Pinhole, RigCamera, Spherical
from sphere_nav.geometry.files import untrusted
from sphere_nav.geometry.files.encoded import decode_file, encoded_size
from sphere_nav.geometry.plausible import check_center, check_lengths, check_mounting
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.photometric import View, build_pyramid, prepare_reference
from sphere_nav.spheres.range_codec import decode_ranges
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.synthesis import synthesize

LENS = Pinhole(40, 30, 30.0, 30.0, 19.5, 14.5)
NOWHERE = SE3(np.full((4, 4), np.nan))
FLAT = np.zeros((30, 40), np.float32)


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    # cameras
    "centre far away": (lambda: replace(LENS, cx=1e12), "centre: expected finite cx, cy"),
    "six numbers of omni": (lambda: Omni(4, 4, 1, 1, 2, 2, 0.5, (0.0,) * 6), "distortion: expected up to 5"),
    "distortion that is no number": (lambda: replace(LENS, distortion=(np.nan,)), "distortion: expected up to"),
    "alpha beyond 1": (lambda: DoubleSphere(4, 4, 1.0, 1.0, 2.0, 2.0, 0.0, 1.5), "alpha"),
    "camera without a place": (lambda: RigCamera("a", LENS, NOWHERE), "T_rig_camera: expected one finite pose"),
    "half of odd sides": (lambda: Spherical(6, 3).halve(), "expected even sides, found 6 x 3"),
    "centre of another size": (lambda: check_center(replace(LENS, cx=29.5), "info"), "expected the principal point"),
    "camera a kilometre up": (lambda: check_mounting(np.array([0.0, 0.0, 1e3]), "tf"), "tf: expected metres"),
    "depth in millimetres": (lambda: check_lengths("depth", np.full(5, 1e5), "depth"), "depth: median: expected"),
    # images and spheres
    "grey level that is none": (lambda: build_pyramid(np.full((30, 40), np.nan, np.float32), LENS), "finite grey"),
    "range of another size": (lambda: prepare_reference(FLAT, FLAT[1:], LENS), "range: expected 40 x 30"),
    "stamp in seconds": (lambda: Sphere(FLAT.astype(np.uint8), FLAT + 1, LENS, 1.5), "integer nanoseconds"),
    "codes of bytes": (lambda: decode_ranges(np.zeros((2, 2), np.uint8)), "range codes: expected uint16"),
    "view of nothing": (lambda: synthesize([], SE3.identity(), LENS), "expected at least one key sphere"),
    "bytes that are no image": (lambda: encoded_size(b"GIF89a" + bytes(20)), "expected PNG or JPEG, found bytes 47"),
    "image without a size": (lambda: encoded_size(b"\xff\xd8\xff\xd9"), "found none in its header"),
    "image cut off": (lambda: decode_file(b"\x89PNG\r\n\x1a\n", 10, 0), "image data|expected"),
    # trajectories
    "fewer poses than stamps": (lambda: Trajectory(np.arange(2), SE3(np.eye(4)[None])), "expected 2 poses"),
    "stamps that fall": (lambda: Trajectory(np.array([2, 1]), SE3(np.eye(4)[None].repeat(2, 0))), "increasing stamps"),
    "covariances of others": (lambda: Trajectory(np.arange(1), SE3(np.eye(4)[None]), np.eye(6)), "1 covariances"),
    # values of text files
    "not JSON": (lambda: untrusted.load_json("x", "{"), "x: expected JSON"),
    "a long YAML": (lambda: untrusted.load_yaml("x", " " * (untrusted.MAX_FILE_BYTES + 1)), "of at most .* characters"),
    "a long word": (lambda: untrusted.load_yaml("x", "a" * (untrusted.MAX_WORD + 1)), "a word of"),
    "many aliases": (lambda: untrusted.load_yaml("x", f"a: &a 1\nb: [{'*a, ' * 20_000}]"), "more than .* aliases"),
    "a field too many": (lambda: untrusted.mapping({"a": 1, "b": 2}, "x", ["a"]), "x.b: expected only a"),
    "a stretched pose": (lambda: untrusted.pose(np.diag([2.0, 1, 1, 1]).tolist(), "x"), "x: rigid motion: expected"),
    "folder above": (lambda: untrusted.path_below(Path("/tmp"), "../etc", "a map"), "expected a map below /tmp"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_nobody_means_is_one_line(what: str) -> None:
    make, expected = REFUSED[what]
    with pytest.raises(ValueError, match=expected) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "read", "expected"),
    [
        (b"\xff\xfe\x00", lambda path: untrusted.read_text(path, "table"), "expected text of a table"),
        (b"PK\x03\x04" + bytes(99), lambda path: untrusted.read_npy(path, "array"), "expected an array, found a file"),
        (b"\x93NUMPY\x01\x00\x10\x00{", lambda path: untrusted.read_npy(path, "array"), "expected an array, found"),
        (b"1.0 0 0 0 0 0 0 2\n", read_tum, ":1: quaternion: expected norm 1, found 2"),
    ],
)
def test_a_file_of_something_else_is_one_line(tmp_path: Path, data: bytes, read: Any, expected: str) -> None:
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(ValueError, match=expected) as caught:
        read(tmp_path / "a")
    assert str(tmp_path / "a") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_just_within_is_taken(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(3))
    assert untrusted.read_npy(tmp_path / "a.npy", "array").tolist() == [0, 1, 2]
    assert untrusted.path_below(tmp_path, "b/c", "a map") == tmp_path / "b" / "c"
    assert untrusted.load_json("x", '{"a": [1]}') == {"a": [1]}
    assert untrusted.load_yaml("x", "a" * untrusted.MAX_WORD) == "a" * untrusted.MAX_WORD
    assert untrusted.pose(SE3.exp(np.ones(6)).matrix.tolist(), "x").distance(SE3.exp(np.ones(6)))[0] < 1e-9
    check_center(LENS, "info")
    check_mounting(np.array([1.0, 0.0, 1.6]), "tf")
    view = View(prepare_reference(np.full((30, 40), 9, np.uint8), FLAT + 2.0, LENS), SE3.identity())
    assert view.reference.num_bytes > 0
