from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_rgbd, sphere_from_view
from sphere_mapping.graph import keyframes
from sphere_mapping.graph.tracking import SphereTracker
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import KeySphereParams, LoopParams, MapperParams
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import optical, sharp_room

NUM_LOST = 2

CAMERA = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
ROOM = sharp_room()
STEP = SE3.exp([0.05, 0.01, 0.0, 0.0, 0.005, 0.02])
NUM_SPHERES = 12
PERIOD_NS = 100_000_000


def poses():
    T_map_sphere = SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])
    for _ in range(NUM_SPHERES):
        yield T_map_sphere
        T_map_sphere = T_map_sphere @ STEP


def seen_from(T_room_sphere, number):
    image, depth_m = ROOM.rgbd(CAMERA, optical(T_room_sphere))
    return sphere_from_rgbd(image, depth_m, CAMERA, stamp_ns=number * PERIOD_NS)


@pytest.fixture(scope="module")
def drive():
    truth = list(poses())
    return truth, [seen_from(T_room_sphere, number) for number, T_room_sphere in enumerate(truth)]


def mapped(spheres, T_map_first, params=None):
    mapper = Mapper(params, T_map_first)
    updates = [mapper.add(sphere) for sphere in spheres]
    return mapper, updates


def errors(updates, truth):
    return np.array([T.distance(update.T_map_sphere) for T, update in zip(truth, updates, strict=True)])


def test_a_map_that_begins_knows_no_features_of_what_was_before():
    kept = {7: None}
    Mapper(features=kept)
    assert not kept


def test_a_drive_is_recovered_and_few_spheres_are_kept(drive):
    truth, spheres = drive
    mapper, updates = mapped(spheres, truth[0])
    found = errors(updates, truth)
    # ideal range and one grey level of rounding: a few millimetres in a room of 8 m
    assert found[:, 0].max() < 0.005
    assert found[:, 1].max() < np.radians(0.1)
    assert updates[0].key_reason == keyframes.FIRST
    assert 1 <= len(mapper.graph) <= NUM_SPHERES // 2
    assert len(mapper.graph.edges) == len(mapper.graph) - 1


@pytest.mark.parametrize(("max_parallax", "is_kept"), [(0.12, True), (0.3, False)])
def test_the_end_of_a_drive_is_kept_where_the_last_key_sphere_is_far(drive, max_parallax, is_kept):
    truth, spheres = drive  # 0.56 m in a room whose median range is 4.8 m
    mapper, updates = mapped(spheres, truth[0], MapperParams(key=KeySphereParams(max_parallax=max_parallax)))
    assert [update.is_key for update in updates] == [True] + [False] * (NUM_SPHERES - 1)
    assert mapper.keep_end() == is_kept
    assert (len(mapper.graph), len(mapper.graph.edges)) == (1 + is_kept, int(is_kept))
    if is_kept:
        assert mapper.graph[1].T_map_sphere.distance(updates[-1].T_map_sphere)[0] < 0.002  # by both ways now
        assert list(mapper.trajectory())[-1][1].distance(mapper.graph[1].T_map_sphere)[0] < 1e-9
    assert not mapper.keep_end()


def test_two_spheres_that_are_lost_and_follow_each_other_do_not_throw_a_map_away(drive, monkeypatch):
    truth, spheres = drive
    mapper, updates = mapped(spheres[:2], truth[0])
    refused = replace(updates[-1].alignment, reason="GAP")
    monkeypatch.setattr(SphereTracker, "align_moving", lambda tracker, current, *_: (current, refused))
    monkeypatch.setattr("sphere_mapping.mapper.is_followed", lambda lost, current: True)
    assert [mapper.add(sphere).T_map_sphere for sphere in spheres[2:4]] == [None, None]
    assert len(mapper.tracks) == 2


@pytest.mark.slow
def test_a_drive_that_was_lost_is_found_again_by_any_key_sphere(drive):
    """Carried away, and put down where the drive began, looking as it did then: the newest key sphere sees nothing."""
    truth, spheres = drive
    away = [T @ SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 2.5]) for T in truth[:3]]
    other = sharp_room(seed=11)
    strange = [sphere_from_rgbd(*other.rgbd(CAMERA, optical(T)), CAMERA, stamp_ns=0) for T in away[:1]] * NUM_LOST
    turned = [seen_from(truth[0] @ SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.25 * k]), 0) for k in range(7)]
    sequence = [*turned, *strange, spheres[0]]
    mapper, updates = mapped([replace(one, stamp_ns=k * PERIOD_NS) for k, one in enumerate(sequence)], truth[0])
    assert [update.T_map_sphere is not None for update in updates] == [True] * 7 + [False] * NUM_LOST + [True]
    assert mapper.tracks[-1].key_id != len(mapper.graph) - 1 or updates[-1].is_key
    assert updates[-1].T_map_sphere.distance(truth[0])[0] < 0.01


@pytest.mark.slow
def test_closing_a_loop_brings_the_end_back_to_the_beginning(drive):
    truth, _ = drive
    key = KeySphereParams(max_parallax=0.01)  # 5 cm: every sphere is kept
    params = MapperParams(key=key, loop=LoopParams(automatic=False, min_way_m=0.2))
    there_and_back = [*range(6), *range(4, -1, -1)]
    mapper, _ = mapped([seen_from(truth[k], n) for n, k in enumerate(there_and_back)], truth[0], params)
    bent = {
        node.id: node.T_map_sphere @ SE3.exp([0.004 * node.id, 0, 0, 0, 0, 0.001 * node.id]) for node in mapper.graph
    }
    mapper.graph = mapper.graph.with_poses(bent)
    assert mapper.close_loops() > 0
    assert any(edge.is_loop for edge in mapper.graph.edges)
    last = mapper.graph[len(mapper.graph) - 1].T_map_sphere
    assert last.distance(truth[0])[0] < 0.01  # it was bent by 40 mm
    joined = [(edge.a, edge.b) for edge in mapper.graph.edges]
    mapper.close_loops()  # what is joined is not joined again, however often it is asked for
    again = [(edge.a, edge.b) for edge in mapper.graph.edges]
    assert again[: len(joined)] == joined
    assert len(set(again)) == len(again)
    assert mapper.graph[len(mapper.graph) - 1].T_map_sphere.distance(truth[0])[0] < 0.01


READOUT_S = 0.068


@pytest.mark.slow
def test_the_spheres_of_a_rolling_shutter_are_straightened_by_the_motion_that_is_found():
    turn = SE3.exp([0.04, 0.0, 0.0, 0.0, 0.01, np.radians(1.2)])
    truth = [SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])]
    for _ in range(9):
        truth.append(truth[-1] @ turn)
    twist = (T_BODY_OPTICAL.inverse() @ turn @ T_BODY_OPTICAL).log() * READOUT_S / (PERIOD_NS * 1e-9)
    found = {}
    for name, is_rolling, is_known in (("global", 0, 0), ("known", 1, 1), ("unknown", 1, 0)):
        mapper, errors = Mapper(None, truth[0]), []
        for number, T_room_sphere in enumerate(truth):
            view = rgbd_view(T_room_sphere, twist * is_rolling)
            sphere = sphere_from_view(view, number * PERIOD_NS)
            update = mapper.add(sphere, None, unroll_of(view, number * PERIOD_NS) if is_known else None)
            errors.append(truth[number].distance(update.T_map_sphere))
        found[name] = np.median(errors[4:], axis=0)
    # The first sphere is straightened when the second tells how the camera moved.
    assert np.all(found["known"] < 1.3 * found["global"] + (0.002, 0.0007))
    assert np.all(found["unknown"] > 2.0 * found["known"])


def test_the_only_key_sphere_of_a_rolling_shutter_is_stored():
    stored = {}
    store = SimpleNamespace(
        add=lambda node, sphere: stored.update({node.id: sphere}), load=stored.get, tell=lambda graph: None
    )
    mapper = Mapper(store=store)
    view = rgbd_view(SE3.identity(), np.zeros(6))
    mapper.add(sphere_from_view(view), None, unroll_of(view, 0))
    assert not mapper.keep_end()
    assert list(stored) == [0]


def rgbd_view(T_room_sphere, twist):
    gray = ROOM.render_rolling(CAMERA, optical(T_room_sphere), twist)
    range_m = ROOM.range_rolling(CAMERA, optical(T_room_sphere), twist)
    depth_m = (range_m * CAMERA.unproject(pixel_grid(CAMERA))[..., 2]).astype(np.float32)
    return RgbdView(np.rint(gray).astype(np.uint8), depth_m, CAMERA)


def unroll_of(view, stamp_ns):
    return lambda velocity: sphere_from_view(replace(view, twist=velocity * READOUT_S), stamp_ns)
