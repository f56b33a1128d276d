"""A body's poses over time: TUM files, association by stamp, interpolation."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sphere_nav.geometry import so3
from sphere_nav.geometry.arrays import Array, Flags, Integers
from sphere_nav.geometry.files.untrusted import number, parse_stamp_ns, read_text
from sphere_nav.geometry.se3 import SE3

MAP_ID = "# map_id:"  # begins a line of comment: the map in whose frame the poses are
TUM_FIELDS = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")
UPPER = np.triu_indices(6)
COVARIANCE_FIELDS = ("stamp", *(f"c{i}{j}" for i, j in zip(*UPPER, strict=True)))
NORM_TOLERANCE = 0.05  # files carry quaternions with few digits; beyond that a column is in the wrong place


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses `T_map_body` (N,) at increasing stamps (N,) in nanoseconds.

    `covariances` (N, 6, 6), where known, are of the tangent (v, omega) in `T_map_body @ exp(xi)`.
    """

    stamps_ns: Integers
    T_map_body: SE3
    covariances: Array | None = None

    def __post_init__(self) -> None:
        count = len(self.stamps_ns)
        if self.T_map_body.matrix.shape != (count, 4, 4):
            raise ValueError(f"trajectory: expected {count} poses, found shape {self.T_map_body.matrix.shape}")
        if np.any(np.diff(self.stamps_ns) <= 0):
            raise ValueError("trajectory: expected increasing stamps")
        if self.covariances is not None and self.covariances.shape != (count, 6, 6):
            raise ValueError(f"trajectory: expected {count} covariances, found shape {self.covariances.shape}")

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, index: slice | NDArray[np.integer] | Flags) -> Trajectory:
        """Pick poses by a slice, indices or a mask."""
        covariances = None if self.covariances is None else self.covariances[index]
        return Trajectory(self.stamps_ns[index], self.T_map_body[index], covariances)

    @property
    def positions(self) -> Array:
        """Origins (N, 3) of the body in the map, in metres."""
        return self.T_map_body.translation

    @property
    def distances(self) -> Array:
        """Distance driven (N,) since the first pose, in metres."""
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=-1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def moved(self, T_new_map: SE3, scale: float = 1.0) -> Trajectory:
        """Return the poses in another map frame, positions scaled before."""
        scaled = SE3.from_parts(self.T_map_body.rotation, scale * self.positions)
        return replace(self, T_map_body=T_new_map @ scaled)

    def at(self, stamps_ns: ArrayLike, max_gap_ns: int | None = None) -> tuple[Trajectory, Flags]:
        """Interpolate: positions along straight lines, rotations along the shortest turn.

        Return the poses at those of `stamps_ns` that lie between two poses at most `max_gap_ns` apart, and the mask
        (M,) of these stamps. Covariances are not interpolated.
        """
        wanted = np.asarray(stamps_ns, dtype=np.int64)
        after = np.minimum(np.searchsorted(self.stamps_ns, wanted, side="left"), len(self) - 1)
        before = np.maximum(after - 1, 0)
        gap, since = self.stamps_ns[after] - self.stamps_ns[before], wanted - self.stamps_ns[before]
        known = (since >= 0) & (since <= gap)
        if max_gap_ns is not None:
            known &= (gap <= max_gap_ns) | (since == 0) | (since == gap)
        share = (since / np.maximum(gap, 1))[known, None]
        T_before, T_after = self.T_map_body[before[known]], self.T_map_body[after[known]]
        turn = so3.log(np.swapaxes(T_before.rotation, -1, -2) @ T_after.rotation)
        position = T_before.translation + share * (T_after.translation - T_before.translation)
        return Trajectory(wanted[known], SE3.from_parts(T_before.rotation @ so3.exp(share * turn), position)), known


def associate(stamps_ns: Integers, other_ns: Integers, tolerance_ns: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pair two increasing lists of stamps: mutually nearest and at most `tolerance_ns` apart; return both indices."""
    if not len(stamps_ns) or not len(other_ns):
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    partner, back = _nearest(stamps_ns, other_ns), _nearest(other_ns, stamps_ns)
    index = np.arange(len(stamps_ns))
    close = np.abs(stamps_ns - other_ns[partner]) <= tolerance_ns
    pairs = np.flatnonzero(close & (back[partner] == index))
    return pairs, partner[pairs]


def _nearest(stamps_ns: Integers, other_ns: Integers) -> NDArray[np.intp]:
    after = np.minimum(np.searchsorted(other_ns, stamps_ns), len(other_ns) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(stamps_ns - other_ns[before] <= other_ns[after] - stamps_ns, before, after)


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Read `stamp x y z qx qy qz qw` lines (seconds, metres) and, where it lies beside, the `.cov` file of `write_tum`.

    Raise ValueError naming file, line and field.
    """
    rows = list(_rows(Path(path), TUM_FIELDS))
    if not rows:
        raise ValueError(f"{path}: expected poses, found none")
    stamps = np.array([stamp for _, stamp, _ in rows], dtype=np.int64)
    values = np.array([numbers for _, _, numbers in rows])
    norms = np.linalg.norm(values[:, 3:], axis=-1)
    for (line, _, _), norm, is_late in zip(rows, norms, np.diff(stamps, prepend=stamps[0] - 1) > 0, strict=True):
        if abs(norm - 1.0) > NORM_TOLERANCE:
            raise ValueError(f"{path}:{line}: quaternion: expected norm 1, found {norm:.3g}")
        if not is_late:
            raise ValueError(f"{path}:{line}: stamp: expected later than the line before")
    return Trajectory(stamps, SE3.from_quaternion(values[:, 3:], values[:, :3]), _read_covariances(Path(path), stamps))


def read_map_id(path: str | os.PathLike[str]) -> str:
    """Return the map in whose frame the poses of a file are, by its line `# map_id: ...`; empty where there is none."""
    for text in read_text(Path(path), "file of poses", errors="replace").split("\n"):
        if not text.startswith("#"):
            break
        if text.startswith(MAP_ID):
            return text.removeprefix(MAP_ID).strip()
    return ""


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory, map_id: str = "") -> None:
    """Write a TUM file; covariances go beside it into a file ending in `.cov`: stamp and the upper triangle by rows.

    `map_id` of the map whose frame the poses are in, where it is known, goes into a line of comment.
    """
    values = np.concatenate([trajectory.positions, trajectory.T_map_body.quaternion], axis=-1)
    _write(Path(path), TUM_FIELDS, trajectory.stamps_ns, values, [f"{MAP_ID} {map_id}"] if map_id else [])
    if trajectory.covariances is not None:
        upper = trajectory.covariances[:, UPPER[0], UPPER[1]]
        _write(Path(path).with_suffix(".cov"), COVARIANCE_FIELDS, trajectory.stamps_ns, upper)
    else:
        Path(path).with_suffix(".cov").unlink(missing_ok=True)  # of an earlier run: would not belong to these poses


def _write(
    path: Path, fields: tuple[str, ...], stamps_ns: Integers, values: Array, comments: Sequence[str] = ()
) -> None:
    lines = [*comments, "# " + " ".join(fields)]
    for stamp, numbers in zip(stamps_ns.tolist(), values.tolist(), strict=True):
        lines.append(f"{stamp // 10**9}.{stamp % 10**9:09d} " + " ".join(f"{number:.9g}" for number in numbers))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _read_covariances(path: Path, stamps_ns: Integers) -> Array | None:
    beside = path.with_suffix(".cov")
    if beside == path or not beside.exists():
        return None
    rows = list(_rows(beside, COVARIANCE_FIELDS))
    found = [stamp for _, stamp, _ in rows]
    if found != stamps_ns.tolist():
        raise ValueError(f"{beside}: expected the {len(stamps_ns)} stamps of {path.name}, found {len(found)} others")
    covariances = np.zeros((len(rows), 6, 6))
    covariances[:, UPPER[0], UPPER[1]] = [numbers for _, _, numbers in rows]
    return covariances + np.swapaxes(np.triu(covariances, 1), -1, -2)


def _rows(path: Path, fields: tuple[str, ...]) -> Iterator[tuple[int, int, list[float]]]:
    """Yield line number, stamp in nanoseconds and the other numbers of every line that is not a comment."""
    for line, text in enumerate(read_text(path, "file of poses", errors="replace").split("\n"), 1):
        words = text.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            if "qw" in words and words[-1] != "qw":
                raise ValueError(f"{path}:{line}: expected columns {' '.join(fields)}, found {' '.join(words)}")
            continue
        if len(words) != len(fields):
            raise ValueError(f"{path}:{line}: expected {len(fields)} columns ({' '.join(fields)}), found {len(words)}")
        values = [number(word, f"{path}:{line}: {field}") for field, word in zip(fields[1:], words[1:], strict=True)]
        yield line, parse_stamp_ns(words[0], f"{path}:{line}: stamp"), values
