"""The last image in every alignment (M15 section 5.3): a short drive in a room, and what is told of three ways."""

import numpy as np
import pytest

from cycab_sim.sensors.imaging import RenderedFrame
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from dense_localizer.track.align import align_rig
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav_tools.cli.experiment import hybrid as module
from sphere_nav_tools.cli.experiment.hybrid import HybridLocalizer, TrackErrors, hybrid_figures, localize
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, drive, make_map
from worlds.room import wide_room

T_WORLD_MAP = SE3.from_planar(7.0, -3.0, 0.5)


@pytest.fixture(scope="module")
def room():
    return wide_room()


@pytest.fixture(scope="module")
def images(room):
    """A drive of 8 images in the world."""
    frames = []
    for k, T_map_camera in enumerate(drive(8)):
        image = room.photograph(PINHOLE, T_map_camera, k)
        frames.append((RenderedFrame(image, None, PINHOLE, (k + 1) * STEP_NS, k), T_WORLD_MAP @ T_map_camera))
    return frames


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Localizer, HybridLocalizer])
def test_a_drive_is_localised_and_compared_with_the_truth(room, images, kind, monkeypatch):
    counts = []

    def count(chosen, *rest):
        counts.append(len(chosen.images[0].views))
        return align_rig(chosen, *rest)

    monkeypatch.setattr(module, "align_rig", count)
    sphere_map = make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0)])
    params = build(LocalizerParams, SMALL_IMAGES | {"state.probation_images": 1, "prior.max_blind_m": 0.0})
    track = localize(kind(params, sphere_map), images, T_WORLD_MAP)
    assert track.is_placed.all()
    assert track.meters.max() < 0.02
    assert np.nanmedian(track.nees) < 20.0
    if kind is HybridLocalizer:
        assert len(track.meters) == len(images)
        assert counts[-1] == counts[0] + 1  # the last image


def test_what_is_told_of_each_way_and_light():
    ours = TrackErrors(np.array([0.01, np.nan, 0.31]), np.array([6.0, np.nan, 18.0]), np.array([4.0, 5.0, 9.0]))
    lost = TrackErrors(np.full(3, np.nan), np.full(3, np.nan), np.array([1.0, 2.0, 3.0]))
    found = {one.name: one for one in hybrid_figures({"dusk": {"map alone": lost, "hybrid (M15)": ours, "ours": ours}})}
    assert found["dusk, ours: images with a pose"].value == pytest.approx(200.0 / 3.0)
    assert found["dusk, ours: error, largest"].value == 0.31
    assert found["dusk, ours: NEES / 6, median"].value == 2.0
    assert found["dusk, map alone: CPU an image, median"].value == 2.0
    assert "dusk, map alone: error, RMSE" not in found
    assert found["ours: poses more than 0.3 m off"].value == 1
    assert not found["ours: poses more than 0.3 m off"].is_met
