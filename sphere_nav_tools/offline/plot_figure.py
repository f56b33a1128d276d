"""Pictures of poses: what a localiser said in a recording (top view, errors, states, timings), and an evaluation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.geometry.trajectory_error import AbsoluteErrors
from sphere_nav.localization.status import TRUSTED, Reason, State, Status
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.camera.odometry_input import TRUTH_WORDS
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.experiences import names_of_experiences
from sphere_nav_tools.offline.evaluation import (
    AUTO,
    TRUTH_TOPICS,
    Judged,
    describe_alignment,
    evaluate_poses,
    truth_topics,
)
from sphere_nav_tools.offline.pose_bags import READINGS, is_bag, read_poses
from sphere_nav_tools.offline.tables import columns

STATUS = "sphere_nav_msgs/msg/LocalizationStatus"
POSE_NAMES = ("pose", "odometry")
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


class Errors(NamedTuple):
    """The truth in the frame of the map, what poses are off it, and in words how the frames were compared."""

    truth: Trajectory
    absolute: AbsoluteErrors
    alignment: str


def find_pose_topic(bag: BagReader) -> str:
    """Return the topic of poses by its last name, those of a pose before odometry; empty where there is none."""
    topics = [info.name for info in bag.topics.values() if info.count and info.type in READINGS]
    named = [t for name in POSE_NAMES for t in sorted(topics) if t.split("/")[-1] == name]
    return next((topic for topic in named if not any(word in topic for word in TRUTH_WORDS)), "")


def find_status(bag: BagReader) -> str:
    """Return the one topic with the status of a localiser; empty: none. BagError for several."""
    topics = sorted(info.name for info in bag.topics.values() if info.type == STATUS and info.count)
    if len(topics) > 1:
        raise BagError(f"{bag.path}: expected one status, found {', '.join(topics)}: choose by --status")
    return topics[0] if topics else ""


def read_statuses(bag: BagReader, topic: str) -> list[Status]:
    """Return what was said of every image, and of silences; BagError for a topic of another type."""
    if not topic:
        return []
    info = bag.require(topic)
    if info.type != STATUS:
        raise BagError(f"{bag.path}: {info.name}: expected {STATUS}, found {info.type}")
    return [conversions.message_to_status(message) for _, _, message in bag.messages([topic])]


def measure(poses: Trajectory | None, truth: Path, *, is_required: bool, alignment: str = AUTO) -> Errors | None:
    """Return truth and errors; None where a bag has no truth that is asked for by nobody.

    alignment: that finds the place of the map in the frame of the truth (`ALIGNMENTS`); the truth is moved to the map.
    """
    if poses is None:
        return None
    if is_bag(truth):
        with BagReader(truth) as bag:
            topics = truth_topics(bag)
        if not topics and not is_required:
            return None
        true = read_poses(truth, tuple(topics) or TRUTH_TOPICS)
    else:
        true = read_tum(truth)
    return errors_in_map(evaluate_poses(poses, true, alignment=alignment, is_interpolated=True))


def errors_in_map(judged: Judged) -> Errors:
    """Return what was judged, in the frame of the map."""
    found = judged.report["alignment"]
    T_map_truth = SE3(np.array(found["T_truth_estimate"])).inverse()
    return Errors(
        judged.truth.moved(T_map_truth, 1.0 / found["scale"]), judged.errors, describe_alignment(judged.report)
    )


def find_experiences(map_path: Path, statuses: list[Status]) -> dict[int, str]:
    """Return by stamp which experience of a map placed an image; BagError where that was another map."""
    with open_map(map_path) as reader:
        names, map_id = names_of_experiences(reader.graph), str(reader.info.map_id)
    others = {status.map_id for status in statuses} - {map_id, ""}
    if others:
        raise BagError(f"{map_path}: map_id: expected that of the recording, {min(others)}, found {map_id}")
    placed = (status for status in statuses if status.state in TRUSTED and status.references)
    return {status.stamp_ns: names[one] for status in placed if (one := status.references[0]) in names}


def describe_experiences(served: dict[int, str]) -> list[str]:
    """Return how many images each experience placed."""
    return columns((number, f"placed by {name}") for name, number in Counter(served.values()).most_common())


def describe_states(statuses: list[Status]) -> list[str]:
    """Return how often each state was told for each reason, with the remedy, and the time for an image."""
    counts = Counter((str(status.state), str(status.reason)) for status in statuses)
    remedies = {(str(status.state), str(status.reason)): status.remedy for status in statuses}
    lines = columns((number, *told, remedies[told]) for told, number in counts.most_common())
    times = [status.milliseconds for status in statuses if status.reason != Reason.TIMEOUT and status.milliseconds > 0]
    if times:
        lines.append(f"time for an image: median {np.median(times):.1f} ms, p99 {np.percentile(times, 99):.1f} ms")
    return lines


def draw_localization(
    path: Path,
    poses: Trajectory | None,
    errors: Errors | None,
    statuses: list[Status],
    served: dict[int, str] | None = None,
) -> None:
    """Draw poses, (truth, errors) and statuses, whatever of them there is; the ending chooses the format.

    served: by stamp, which experience of the map placed an image.
    """
    stamps = [status.stamp_ns for status in statuses] or (list(poses.stamps_ns) if poses is not None else [0])
    start = int(min(stamps))
    lines = {} if errors is None else {"truth": errors.truth.positions[:, :2]}
    marks = {}
    if poses is not None and len(poses):
        lines["pose"] = poses.positions[:, :2]
        by = [(served or {}).get(int(stamp)) for stamp in poses.stamps_ns]
        marks = {f"by {name}": lines["pose"][[one == name for one in by]] for name in dict.fromkeys(filter(None, by))}
    errors_of = [] if errors is None else [partial(_draw_sides, errors), partial(_draw_sizes, errors)]
    said = [partial(_draw_states, statuses), partial(_draw_times, statuses)] if statuses else []
    with drawn(path, (13, 7)) as figure:
        views = [*errors_of, *said]
        cells = figure.add_gridspec(max(len(views), 1), 2, width_ratios=(1.0, 1.4))
        top_view(figure.add_subplot(cells[:, 0]), lines, marks)
        figure.suptitle(errors.alignment if errors is not None else "", fontsize="small")
        axes: Axes | None = None
        for row, draw in enumerate(views):
            axes = figure.add_subplot(cells[row, 1], sharex=axes)
            draw(axes, start)
        if axes is not None:
            axes.set_xlabel("time [s]")


@contextmanager
def drawn(path: Path, size: tuple[float, float]) -> Iterator[Figure]:
    """Give a figure of a size in inches to draw in, then write it; the ending chooses the format."""
    with mpl.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        figure.savefig(path, dpi=120)


def top_view(axes: Axes, lines: Mapping[str, Array], marks: Mapping[str, Array]) -> None:
    """Draw paths (N, 2) from above by name, the true one before the last, marked places, and where the last begins."""
    for number, (name, path) in enumerate(reversed(list(lines.items()))):
        color, width, size = (TRUTH, 4, 0) if number else (ESTIMATE, 1, 2)
        axes.plot(*path.T, ".-", label=name, color=color, lw=width, ms=size, zorder=2 - number)
    for number, (name, places) in enumerate(marks.items()):
        axes.plot(*places.T, "o", color=f"C{number + 1}", ms=4, label=name)
    for name, path in list(lines.items())[-1:]:
        axes.plot(*path[0], "o", color="black", ms=5, label="start")
        axes.plot(*path[-1], "s", color="black", ms=5, label="end")
        axes.set_title(f"From above: {len(path)} places of {name.split(',')[0]}", loc="left")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2, frameon=False)
    in_meters(axes)


def in_meters(axes: Axes) -> None:
    """Let both axes of a view from above have one scale."""
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="datalim")


def runs_of(statuses: list[Status], start: int) -> list[tuple[State, str, float, float]]:
    """Return state, reason, first and last second of every run of equal ones; a run lasts until the next begins."""
    runs = []
    ordered = sorted(statuses, key=lambda status: status.stamp_ns)
    for (state, reason), members in groupby(ordered, key=lambda status: (status.state, str(status.reason))):
        stamps = [(status.stamp_ns - start) * 1e-9 for status in members]
        runs.append((state, reason, stamps[0], stamps[-1]))
    ends = [run[2] for run in runs[1:]] + [runs[-1][3]] if runs else []
    return [(state, reason, first, end) for (state, reason, first, _), end in zip(runs, ends, strict=True)]


def _draw_sides(errors: Errors, axes: Axes, start: int) -> None:
    seconds = (errors.truth.stamps_ns - start) * 1e-9
    axes.plot(seconds, errors.absolute.lateral_m, color=LATERAL, lw=1, label="lateral (left)")
    axes.plot(seconds, errors.absolute.longitudinal_m, color=LONGITUDINAL, lw=1, label="longitudinal (ahead)")
    median = 1e3 * float(np.median(errors.absolute.translation_m))
    axes.set_title(f"Error of {len(seconds)} poses, median {median:.3g} mm", loc="left")
    axes.set_ylabel("error [m]")
    legend_above(axes)


def _draw_sizes(errors: Errors, axes: Axes, start: int) -> None:
    seconds, turned = (errors.truth.stamps_ns - start) * 1e-9, axes.twinx()
    axes.plot(seconds, errors.absolute.translation_m, color=ESTIMATE, lw=1)
    turned.plot(seconds, np.degrees(errors.absolute.rotation_rad), color=ROTATION, lw=1)
    for side, name, color in ((axes, "translation [m]", ESTIMATE), (turned, "rotation [°]", ROTATION)):
        side.set_ylabel(f"error of {name}", color=color)
        side.set_ylim(bottom=0.0)
    turned.grid(visible=False)


def legend_above(axes: Axes) -> None:
    """Put the legend above a view, where no curve is."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, borderaxespad=0.1)


def _draw_states(statuses: list[Status], axes: Axes, start: int) -> None:
    axes.set_title(f"State, and reason, of {len(statuses)} images", loc="left")
    runs = runs_of(statuses, start)
    present = [state for state in State if any(run[0] == state for run in runs)]
    reasons = sorted({reason for _, reason, _, _ in runs if reason})
    names = [*present, *reasons]
    rows = {str(name): row for row, name in enumerate(names)}
    for state, reason, first, end in runs:
        width = max(end - first, 1e-3)
        axes.broken_barh([(first, width)], (rows[str(state)] - 0.4, 0.8), color=COLORS[State(state)])
        if reason:
            axes.broken_barh([(first, width)], (rows[reason] - 0.2, 0.4), color=COLORS[State(state)])
    axes.set_yticks(range(len(names)), [str(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)


def _draw_times(statuses: list[Status], axes: Axes, start: int) -> None:
    timed = [status for status in statuses if status.milliseconds > 0.0]
    seconds = np.array([(status.stamp_ns - start) * 1e-9 for status in timed])
    axes.plot(seconds, [status.milliseconds for status in timed], ".", color=ESTIMATE, ms=3)
    axes.set_ylabel("[ms]")
    axes.set_title(f"Time for each of {len(timed)} images", loc="left")
    if timed:
        axes.set_yscale("log")
