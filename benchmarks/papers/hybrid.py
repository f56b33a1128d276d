"""`hybrid`: M15 section 5.3 to the letter beside what `dense_localizer` does, in several lights.

M15 adds the error to the last image to that of the map in every image. Here the last image joins only where the map is
refused. Both, and the map alone, get the same images of a drive in the taught map, without messages.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.papers.drives import PaperDrive
from benchmarks.papers.result import JudgedFigure, write_result
from cycab_sim.params import SimParams
from cycab_sim.sensors.imaging import RenderedFrame
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.localizer import Localizer
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.likeness import Tried
from dense_localizer.track.align import align_rig
from dense_localizer.track.visual_odometry import add_last
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.params import build
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.cli.demo.demo import BUSY, OTHER_DAY, rms
from sphere_nav_tools.cli.demo.plots import save_figure

STEP, PERIOD_NS = 0.28, 200_000_000  # m and ns from image to image: 1.4 m/s at 5 Hz
WAY = 60.0  # m of the path, with its first bend
WRONG = 0.3  # m: a pose that a car should not be driven by
LIGHTS: Mapping[str, Mapping[str, Any]] = {  # of the second drive
    "as taught": {},
    "traffic, clouds": BUSY | OTHER_DAY,
    "overcast": BUSY | {"traffic.seed": 1, "condition": "overcast"},
    "low sun": BUSY | {"traffic.seed": 1, "condition": "low_sun"},
    "saturated": BUSY | {"traffic.seed": 1, "light.exposure": 4.0},
    "head lamp": {"condition": "night_torch"},
}


class HybridLocalizer(Localizer):
    """Every image is aligned with the map and with the last image at once (M15 section 5.3)."""

    _last: PoseCandidate | None = None

    def _locate(self, frame: LocalizerInput, prediction: Prediction, tried: Tried = ()) -> PoseCandidate:
        """As the localiser does, the last image among the references; judged with it."""
        by_map = chosen = self.references.choose_rig(frame.images, prediction, instead_of=tried)
        if self._last is not None and self._states.is_following:
            chosen = replace(chosen, images=add_last(chosen, self._last, self.params.registration) or chosen.images)
        alignment = align_rig(chosen, prediction, self.params)
        candidate = self._integrity.assess(chosen, alignment, prediction, self._states.state)
        return replace(candidate, images=by_map.covered)  # whose range the next image has

    def _update(self, frame: LocalizerInput, candidate: PoseCandidate) -> CameraEstimate:
        self._last = candidate
        return super()._update(frame, candidate)


WITHOUT_IMAGES = {"prior.max_blind_m": 0.0}
WAYS: Mapping[str, tuple[type[Localizer], Mapping[str, Any]]] = {
    "map alone": (Localizer, WITHOUT_IMAGES),
    "hybrid (M15)": (HybridLocalizer, WITHOUT_IMAGES),
    "ours": (Localizer, {}),
}


@dataclass(frozen=True, eq=False)
class TrackErrors:
    """Of each image: error (K,) m, NaN without a pose; its square by the covariance (K,); CPU time (K,) ms."""

    meters: Array
    nees: Array
    milliseconds: Array

    @property
    def is_placed(self) -> NDArray[np.bool_]:
        """Which images have a pose."""
        return ~np.isnan(self.meters)


class Hybrid(PaperDrive):
    """Teach and map as ever; then images, no drive."""

    purpose = "map and last image in every image (M15 5.3), map alone, and ours, in six lights; no messages"

    def run(self) -> bool:
        """Localise the images of each light in each way; judge."""
        self.prepare()
        T_world_map, found = self.anchor(), dict[str, dict[str, TrackErrors]]()
        with self.stage("localise"), open_map(self.taught / "map") as made:
            for light, values in LIGHTS.items():
                images = list(tqdm(self.record(values), desc=light, total=round(WAY / STEP), disable=None))
                found[light] = {
                    name: localize(kind(build(LocalizerParams, params), made), images, T_world_map)
                    for name, (kind, params) in WAYS.items()
                }
        self.plot(found)
        return write_result(self.folder, self.name, self.seed, list(hybrid_figures(found)))

    def record(self, values: Mapping[str, Any]) -> Iterator[tuple[RenderedFrame, SE3]]:
        """Draw images along the path, each with its true pose."""
        simulator = Simulator(build(SimParams, self.simulation | {"rig.kind": "none"} | dict(values)))
        T_base_camera = simulator.mounts["camera"].T_base_camera
        for x, y, yaw in self.path.at(np.arange(round(WAY / STEP)) * STEP)[:, :3]:
            simulator.teleport(float(x), float(y), float(yaw))
            yield simulator.capture("camera"), simulator.T_world_base @ T_base_camera
            simulator.step(VehicleCommand(), PERIOD_NS)

    def plot(self, found: Mapping[str, Mapping[str, TrackErrors]]) -> None:
        """Draw the errors along the path."""
        figure, panels = plt.subplots(2, 3, figsize=(14, 8), sharex=True, sharey=True)
        for axes, (light, tracks) in zip(panels.ravel(), found.items(), strict=True):
            for name, track in tracks.items():
                share = 100.0 * track.is_placed.mean()
                axes.plot(np.arange(len(track.meters)) * STEP, 100.0 * track.meters, label=f"{name}: {share:.0f} %")
            axes.set(title=light, xlabel="place on the path [m]", ylabel="error of the pose [cm]", yscale="log")
            axes.grid(alpha=0.3)
            axes.legend(title="images with a pose")
        save_figure(figure, self.folder / "errors.png")


def localize(localizer: Localizer, images: list[tuple[RenderedFrame, SE3]], T_world_map: SE3) -> TrackErrors:
    """Localise images one after the other, the first one near its true pose."""
    T_map_world = T_world_map.inverse()
    localizer.relocalize(T_map_world @ images[0][1])
    rows = []
    for frame, T_world_camera in images:
        begun = time.process_time()
        estimate = localizer.update(frame.image, frame.camera, frame.stamp_ns)
        spent = 1e3 * (time.process_time() - begun)
        if estimate.T_map_camera is None or estimate.covariance is None:
            rows.append((np.nan, np.nan, spent))
            continue
        xi = ((T_map_world @ T_world_camera).inverse() @ estimate.T_map_camera).log()
        rows.append((float(np.linalg.norm(xi[:3])), float(xi @ np.linalg.solve(estimate.covariance, xi)), spent))
    localizer.references.close()
    return TrackErrors(*np.array(rows).T)


def hybrid_figures(found: Mapping[str, Mapping[str, TrackErrors]]) -> Iterator[JudgedFigure]:
    """Tell each light and way; ours places no image wrongly, nor fewer than the map alone."""
    for light, tracks in found.items():
        for name, track in tracks.items():
            what, placed = f"{light}, {name}", track.meters[track.is_placed]
            yield JudgedFigure(f"{what}: images with a pose", 100.0 * float(track.is_placed.mean()), "%")
            if len(placed):
                yield JudgedFigure(f"{what}: error, RMSE", rms(placed), "m")
                yield JudgedFigure(f"{what}: error, largest", float(placed.max()), "m")
                yield JudgedFigure(f"{what}: NEES / 6, median", float(np.nanmedian(track.nees)) / 6.0)
            yield JudgedFigure(f"{what}: CPU an image, median", float(np.median(track.milliseconds)), "ms")
    ours = [tracks["ours"] for tracks in found.values()]
    wrong = sum(int(np.sum(track.meters > WRONG)) for track in ours)
    yield JudgedFigure(f"ours: poses more than {WRONG:g} m off", wrong, "", 0.0)
