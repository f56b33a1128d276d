"""Particles that find a place: what is measured of them, and one small run in a room."""

import numpy as np
import pytest

from mcl_depth.belief.particles import Particles
from mcl_depth.geometry.mesh import mesh_from_faces
from mcl_depth.likeness.comparison import visual_features
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.params import build
from sphere_nav_tools.cli.experiment.convergence import (
    SETTINGS,
    KidnappedDrive,
    ParticleCurves,
    distances_of,
    figures,
    noisy_odometry,
    plot_curves,
    plot_ways,
    run_particles,
)
from worlds.boxes import box

LINE = np.array([[-1.5 + 0.25 * k, -1.0, 0.1] for k in range(8)])


@pytest.fixture(scope="module")
def site():
    vertices = np.concatenate([box((-3, -2, 0), (3, 2.5, 2.6)), box((1.0, 1.2, 0), (2.2, 2.5, 2.0))])
    mesh = mesh_from_faces(vertices, np.arange(len(vertices)).reshape(-1, 3), "room")
    return Site(mesh, 1.2, build(FilterParams, {"camera_height": 1.2}), is_ready=False)


def features(site, pose):
    """Of an image that has an edge wherever the depth has one."""
    depth = np.nan_to_num(site.synthesizer.synthesize_many(np.array([[*pose[:2], 1.2]]))[0], nan=9.0)
    shift = round(pose[2] / (2 * np.pi) * depth.shape[1])
    return visual_features(np.roll(255.0 / (1.0 + depth), shift, axis=1).astype(np.float32), None)


def test_a_small_run_finds_the_place_in_a_room(site):
    drive = KidnappedDrive(
        [features(site, pose) for pose in LINE], LINE, noisy_odometry(LINE, np.random.default_rng(1))
    )
    found = run_particles(site, drive, 300, np.random.default_rng(2), is_adjusted=True)
    mean, best, nearest = found.distances[-1]
    assert found.distances[0, 0] > 1.0  # all over the room
    assert mean < 0.5 * found.distances[0, 0]
    assert nearest <= min(mean, best)
    assert nearest < 0.3
    assert found.trajectory.shape == LINE.shape
    assert found.hit_rates[-1].min() > 0.5  # particles share their depth images, and the images are known by now


def test_distances_are_of_the_mean_the_heaviest_and_the_nearest():
    poses = np.array([[3.0, 4.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 1.0]])
    particles = Particles.of_equal_weight(poses).reweight(np.array([0.5, 0.2, 0.3]))
    assert distances_of(particles, np.zeros(3)) == pytest.approx((0.5 * 5 + 0.2 + 0.6, 5.0, 1.0))


def test_odometry_begins_at_the_origin_and_drifts():
    line = np.column_stack([np.arange(50.0), np.full(50, 7.0), np.zeros(50)])
    found = noisy_odometry(line, np.random.default_rng(3))
    assert found[0].tolist() == [0.0, 0.0, 0.0]
    assert np.hypot(*np.diff(found[:, :2], axis=0).T) == pytest.approx(1.0, abs=0.25)
    assert 0.1 < np.hypot(*(found[-1, :2] - [49.0, 0.0])) < 20.0


def curves(meters):
    line = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])
    return ParticleCurves(np.full((4, 3), meters), np.full((4, 2), 0.5), line + np.array([0.0, meters, 0.0]))


@pytest.mark.slow
def test_what_is_judged_is_the_number_of_runs_and_what_the_adjustment_gains(tmp_path):
    drives = [KidnappedDrive([], curves(0.0).trajectory, np.zeros((4, 3)))] * 2
    found = {name: [curves(0.5), curves(0.5 if "adjusted" in name else 5.0)] for name in SETTINGS}
    told = {figure.name: figure for figure in figures(found, drives)}
    assert told["1000, as drawn: mean within 1 m at the end"].value == 50.0
    assert told["1000, as drawn: way by accumulated weight, RMSE"].value == pytest.approx(2.75)
    assert told["adjusted against drawn headings, 1000 particles"].value == 50.0
    assert not told["runs of each setting"].is_met  # two of twenty
    plot_curves(tmp_path / "curves.png", found)
    plot_ways(tmp_path / "ways.png", found["1000, adjusted"], drives)
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    assert (tmp_path / "ways.png").stat().st_size > 5_000
