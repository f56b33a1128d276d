"""Pictures of poses: what a localiser said in a recording (top view, errors, states, timings), and an evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sphere_nav_msgs.msg import LocalizationStatus

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.localization.status import State, Status
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.interfaces import type_name
from sphere_nav_tools.offline.evaluation import Judged, describe_alignment

COLORS = {  # of Okabe and Ito, whom nobody's eyes fail
    State.UNCONFIGURED: "#5f6368",
    State.NO_MAP: "#5f6368",
    State.NOT_LOCALISED: "#9aa0a6",
    State.SEARCHING: "#56B4E9",
    State.PROBATION: "#F0E442",
    State.TRACKING: "#009E73",
    State.DEGRADED: "#E69F00",
    State.LOST: "#D55E00",
}
TRUTH, ESTIMATE, LATERAL, LONGITUDINAL, ROTATION = "#9aa0a6", "#0072B2", "#D55E00", "#0072B2", "#E69F00"


def read_statuses(bag: BagReader, topic: str | None = None) -> list[Status]:
    """Return what was said of every image, and of silences, on a topic or on the only one that tells it.

    BagError for several, and for a topic of another type.
    """
    kind = type_name(LocalizationStatus)
    offered = sorted(info.name for info in bag.topics.values() if info.type == kind and info.count)
    topics = [topic] if topic else offered
    if len(topics) > 1:
        raise BagError(f"{bag.path}: expected one status, found {', '.join(topics)}: choose by --status")
    if not topics:
        return []
    info = bag.require(topics[0], LocalizationStatus)
    return [conversions.message_to_status(message) for _, _, message in bag.messages([info.name])]


def draw_localization(
    path: Path,
    poses: Trajectory | None,
    judged: Judged | None,
    statuses: list[Status],
) -> None:
    """Draw poses, truth with errors, and statuses, whatever of them there is; the ending chooses the format.

    Poses are drawn in the frame of the truth.
    """
    lines, views, alignment = {}, [], ""
    if judged is not None and poses is not None:
        lines, alignment = {"truth": judged.truth.positions[:, :2]}, describe_alignment(judged)
        views = [partial(_draw_sides, judged), partial(_draw_turns, judged)]
        poses = poses.moved(judged.T_truth_estimate, judged.scale)
    if poses is not None and len(poses):
        lines["pose"] = poses.positions[:, :2]
    if statuses:
        views += [partial(_draw_states, statuses), partial(_draw_times, statuses)]
    with drawn(path, (13, 7)) as figure:
        cells = figure.add_gridspec(max(len(views), 1), 2, width_ratios=(1.0, 1.4))
        top_view(figure.add_subplot(cells[:, 0]), lines)
        figure.suptitle(alignment, fontsize="small")
        axes: Axes | None = None
        for row, draw in enumerate(views):
            axes = figure.add_subplot(cells[row, 1], sharex=axes)
            draw(axes)
        if axes is not None:
            axes.set_xlabel("time [s]")


@contextmanager
def drawn(path: Path, size: tuple[float, float]) -> Iterator[Figure]:
    """Give a figure of a size in inches to draw in, then write it; the ending chooses the format."""
    with mpl.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        figure.savefig(path, dpi=120)


def top_view(axes: Axes, lines: Mapping[str, Array], marks: Mapping[str, Array] = {}) -> None:
    """Draw paths (N, 2) from above by name, the true one before the last, marked places, and where the last begins."""
    name, path = "", np.zeros((0, 2))
    styles: tuple[dict[str, Any], ...] = ({"color": TRUTH, "lw": 4, "ms": 0}, {"color": ESTIMATE, "lw": 1, "ms": 2})
    for (name, path), style in zip(lines.items(), styles[-len(lines) :], strict=False):
        axes.plot(*path.T, ".-", label=name, **style)
    for label, places in marks.items():
        axes.plot(*places.T, "o", color="C1", ms=4, label=label)
    axes.plot(*path[:1].T, "o", color="black", ms=5, label="start")
    axes.plot(*path[-1:].T, "s", color="black", ms=5, label="end")
    axes.set_title(f"From above: {len(path)} places of {name.split(',')[0]}", loc="left")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2, frameon=False)
    in_meters(axes)


def in_meters(axes: Axes) -> None:
    """Let both axes of a view from above have one scale."""
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="datalim")


def _draw_sides(judged: Judged, axes: Axes) -> None:
    seconds, errors = judged.truth.stamps_ns * 1e-9, judged.errors
    axes.set_prop_cycle(color=(TRUTH, LATERAL, LONGITUDINAL))
    sizes = np.column_stack([errors.translation_m, errors.lateral_m, errors.longitudinal_m])
    axes.plot(seconds, sizes, lw=1, label=["size", "lateral (left)", "longitudinal (ahead)"])
    median = 1e3 * float(np.median(errors.translation_m))
    axes.set_title(f"Error [m], median {median:.3g} mm", loc="left")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, borderaxespad=0.1)


def _draw_turns(judged: Judged, axes: Axes) -> None:
    axes.plot(judged.truth.stamps_ns * 1e-9, np.degrees(judged.errors.rotation_rad), color=ROTATION, lw=1)
    axes.set_title("Error of the rotation [°]", loc="left")


def _draw_states(statuses: list[Status], axes: Axes) -> None:
    """Draw a mark for each image in the row of its state, and in that of its reason."""
    axes.set_title(f"State, and reason, of {len(statuses)} images", loc="left")
    for words in ([str(status.state) for status in statuses], [str(status.reason) for status in statuses]):
        told = [(one, word) for one, word in zip(statuses, words, strict=True) if word]
        seconds = [one.stamp_ns * 1e-9 for one, _ in told]
        axes.scatter(seconds, [word for _, word in told], c=[COLORS[one.state] for one, _ in told], marker="|", s=80)
    axes.margins(y=0.2)
    axes.invert_yaxis()


def _draw_times(statuses: list[Status], axes: Axes) -> None:
    timed = [status for status in statuses if status.milliseconds > 0.0]
    seconds = [status.stamp_ns * 1e-9 for status in timed]
    axes.semilogy(seconds, [status.milliseconds for status in timed], ".", color=ESTIMATE, ms=3)
    axes.set_title(f"Time for each of {len(timed)} images [ms]", loc="left")
