"""A calibration as plain values for JSON, and as a picture of residuals and coverage of every camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rig_calibration.boards.bundle import rms_px
from rig_calibration.boards.quality import covered_cells, median_known, tilt_deg
from rig_calibration.boards.validation import camera_rms
from rig_calibration.calibrate import Calibration
from rig_calibration.constants import NUM_DISTORTION
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import free_parameters


def calibration_as_mapping(calibration: Calibration) -> dict[str, Any]:
    """Return everything worth knowing; null where a number is not known or an axis cannot be observed."""
    rms = camera_rms(calibration.start.problem, calibration.residuals, calibration.kept)
    covered = coverage(calibration)
    cameras = {}
    for index, spec in enumerate(calibration.specs):
        std, halves = calibration.spread.pose_std[index], calibration.validation.halves[index]
        own = np.flatnonzero(calibration.start.problem.seen.camera == index)
        num_lens = int(np.flatnonzero(free_parameters(spec.model, NUM_DISTORTION))[-1]) + 1
        cameras[spec.name] = {
            "model": spec.model,
            "lens": [float(value) for value in calibration.state.lenses[index][:num_lens]],
            "lens_std": [*map(_known, calibration.spread.lens_std[index][:num_lens])],
            "rms_px": float(rms[index]),
            "held_out_rms_px": _known(calibration.validation.held_out_px[index]),
            "coverage_percent": float(covered[index]),
            "blur_px": _known(median_known([calibration.start.views[k].blur_px for k in own])),
            "tilt_deg": tilt_deg(calibration.start.problem, calibration.state, own),
            "halves_focal_percent": _known(100.0 * calibration.validation.focal_halves[index]),
            "position_std_mm": [*map(_known, 1e3 * std[:3])],
            "rotation_std_deg": [*map(_known, np.degrees(std[3:]))],
            "halves_position_mm": [*map(_known, 1e3 * halves[:3])],
            "halves_rotation_deg": [*map(_known, np.degrees(halves[3:]))],
        }
    return {
        "cameras": cameras,
        "rms_px": rms_px(calibration.residuals, calibration.kept),
        "noise_px": calibration.spread.noise_px,
        "num_views": len(calibration.start.views),
        "rejected_views": calibration.dropped,
        "rejected_corners": int(np.count_nonzero(calibration.kept == 0)),
        "warnings": calibration.warnings,
    }


def coverage(calibration: Calibration) -> Array:
    """Return the part of 8 x 6 cells of every image that a corner fell into (C,), in percent."""
    return 100.0 * covered_cells(calibration.start.problem, calibration.kept).mean(axis=(1, 2))


def draw_calibration(calibration: Calibration, path: Path) -> None:
    """Draw where corners were seen, coloured by residual, and the residuals themselves, one column for a camera."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    seen, count = calibration.start.problem.seen, len(calibration.specs)
    figure = Figure(figsize=(3.2 * count, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, count, squeeze=False)
    limit = max(3.0 * calibration.spread.noise_px, 1e-3)
    rms, covered = camera_rms(calibration.start.problem, calibration.residuals, calibration.kept), coverage(calibration)
    for index, rows in seen.camera_slices:
        spec, kept = calibration.specs[index], calibration.kept[rows] > 0
        pixels, errors = seen.pixels[rows], np.nan_to_num(calibration.residuals[rows])
        size = np.linalg.norm(errors, axis=-1)
        points = axes[0, index].scatter(*pixels[kept].T, c=size[kept], s=2, vmin=0, vmax=limit)
        axes[0, index].plot(*pixels[~kept].T, "rx", ms=3)
        title = f"{spec.name}\nRMS {rms[index]:.3f} px, {covered[index]:.0f} % covered"
        axes[0, index].set(title=title, xlim=(0, spec.size[0]), ylim=(spec.size[1], 0), aspect="equal")
        axes[1, index].plot(*errors[kept].T, ".", ms=1.5)
        axes[1, index].set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal", xlabel="residual in px")
    figure.colorbar(points, ax=list(axes[0]), label="residual in px", shrink=0.8)
    figure.savefig(path, dpi=110)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
