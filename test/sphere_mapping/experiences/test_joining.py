"""A drive in light that nobody knows is placed by the localizer, features, a start that ranges confirm, or not."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.experiences import joining
from sphere_mapping.experiences.joining import DriveSphere, Localized, Place, join_drive, locate_edges
from sphere_mapping.graph.keyframes import Track
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.range_alignment import RangeImage
from sphere_nav.spheres.sphere import Sphere
from worlds.room import sharp_room
from worlds.submaps import images_of, submap_of

CAMERA = Spherical(160, 110, 512.0, 176.0, 60.0)
BASE = [SE3.from_planar(0.3 * k, 0.1, 0.3 + 0.1 * k) for k in range(3)]
DRIVE = [SE3.from_planar(0.05 + 0.3 * k, 0.05, 0.32 + 0.1 * k) for k in range(3)]


FAR = SE3.from_planar(5.0, -3.0, 1.2)  # where the drive thinks it began
HALF = np.array([3.5, 2.5, 1.5])


class Cave:
    """A box room, and balls on its walls so that no two corners are alike; without balls every corner is like one."""

    def __init__(self, num_balls=12, seed=5):
        rng = np.random.default_rng(seed)
        directions = rng.uniform(-1.0, 1.0, (num_balls, 3))
        self.centers = directions / np.abs(directions).max(axis=1, keepdims=True) * HALF
        self.radii = rng.uniform(0.3, 0.9, num_balls)

    def sphere(self, pose, is_dark=False, camera=CAMERA):
        sphere = sharp_room(tuple(HALF)).sphere(pose, camera)
        rays, range_m = pixel_rays(camera) @ pose.rotation.T, sphere.range_m
        for center, radius in zip(self.centers - pose.translation, self.radii, strict=True):
            along = rays @ center
            square = along**2 - center @ center + radius**2
            hit = np.where(square > 0, along - np.sqrt(np.maximum(square, 0.0)), np.inf)
            range_m = np.where(hit > 0.2, np.minimum(hit, range_m), range_m).astype(np.float32)
        return Sphere(np.ones_like(sphere.image) if is_dark else sphere.image, range_m, camera)


def submap(cave, poses, first_id, T=None, **values):
    return submap_of(lambda k: cave.sphere(poses[k], **values), poses, first_id, T)


def worst_m(joined):
    return max(float(joined.graph[100 + k].T_map_sphere.distance(pose)[0]) for k, pose in enumerate(DRIVE))


@pytest.fixture(scope="module")
def base():
    return submap(Cave(), BASE, 0)


@pytest.fixture(scope="module")
def night():
    return submap(Cave(), DRIVE, 100, FAR, is_dark=True)


@pytest.mark.slow
def test_a_drive_in_the_dark_is_placed_by_a_start_and_ranges(base, night):
    joined = join_drive(base, night, images_of(night), DRIVE[0] @ SE3.from_planar(0.1, -0.1, 0.05))
    assert joined.graph is not None, joined.told
    assert worst_m(joined) < 0.01
    assert all(joined.graph[node.id].T_map_sphere is node.T_map_sphere for node in base.graph)  # the map stays
    assert joined.told.endswith("a start was given; ranges fit at 3 of 3 places, 3 tell where")


def test_ranges_fit_best_where_the_drive_was(base, night):
    true = SphereGraph(KeySphere(100 + k, k, pose) for k, pose in enumerate(DRIVE))
    load_base = cache(lambda one: RangeImage.from_sphere(base.load(one)))
    places = joining.find_places(base.graph, true, images_of(night), load_base)
    assert [place.node.id for place in places] == [0, 1, 2]
    assert joining.find_rival(places, load_base) == 0.0
    moved = [replace(place, T_node_image=place.moved(np.array([0.0, -0.5, 0.0]))) for place in places]
    assert joining.find_rival(moved, load_base) == 0.5


def test_a_place_is_moved_along_the_axes_of_the_map(base):
    node = base.graph[2]
    place = Place(node, None, node.T_map_sphere.inverse() @ DRIVE[2])
    by_m = np.array([0.3, -0.2, 0.1])
    T_map_image = node.T_map_sphere @ place.moved(by_m)
    np.testing.assert_allclose(T_map_image.translation, DRIVE[2].translation + by_m, atol=1e-12)
    np.testing.assert_allclose(T_map_image.rotation, DRIVE[2].rotation, atol=1e-12)


@pytest.mark.slow
def test_elsewhere_nothing_is_joined(base):
    elsewhere = submap(Cave(seed=9), DRIVE, 100, FAR, is_dark=True)
    for start in (None, DRIVE[0]):
        assert join_drive(base, elsewhere, images_of(elsewhere), start).graph is None


WHOLE = Spherical(64, 32)


def test_a_start_that_ranges_do_not_confirm_is_refused():
    """They fit at two of three places, and chance does as much for every hundredth start."""
    dark = {"camera": WHOLE, "is_dark": True}
    caves = [Cave(), Cave(), Cave(seed=9)]
    changed = submap_of(lambda k: caves[k].sphere(DRIVE[k], **dark), DRIVE, 100, FAR)
    found = join_drive(submap(Cave(), BASE, 0, **dark), changed, images_of(changed), DRIVE[0])
    assert found.graph is None
    assert found.told.endswith("a start was given; ranges fit at 2 of 3 places, 2 tell where")


def test_features_join_a_drive_by_day_before_anything_is_searched_by_parts():
    known, day = (with_features(submap(Cave(), *of)) for of in ((BASE[:2], 0), (DRIVE[:2], 100, FAR)))
    first = joining.find_first(known, day, images_of(day), None, map, None)
    assert first.told.endswith("2 of these agree on one place")
    assert {edge.b for edge in first.edges} == {100, 101}
    assert first.is_certain


def with_features(part):
    index = AppearanceIndex()
    for node in part.graph:
        index.add(node.id, features_of_sphere(part.load(node.id)))
    return replace(part, index=index)


def test_what_the_localizer_placed_counts_before_all(base, night):
    """Two of three key spheres, as the localizer saw them: the other by the drive's own motions."""
    sure = {100 + k: Localized(k, BASE[k].inverse() @ DRIVE[k], 1e-6 * np.eye(6), is_sure=k != 2) for k in (0, 1, 2)}
    edges = list(locate_edges(images_of(night, sure)))
    assert [(edge.a, edge.b) for edge in edges] == [(0, 100), (1, 101)]  # it was not sure of the third
    joined = join_drive(base, night, images_of(night, sure))
    assert "placed 2 of 3" in joined.told
    assert worst_m(joined) < 0.01


def test_a_join_by_an_image_beside_its_key_sphere_is_that_of_the_key_sphere(base, night):
    T_key_sphere = SE3.from_planar(0.1, 0.02, 0.05)
    located = Localized(0, BASE[0].inverse() @ DRIVE[0] @ T_key_sphere, 1e-6 * np.eye(6), is_sure=True)
    (edge,) = locate_edges([DriveSphere(Track(7, 100, T_key_sphere), located, lambda: None)])
    assert edge.T_a_b.distance(BASE[0].inverse() @ DRIVE[0])[0] < 1e-9


def test_the_covariance_of_a_join_is_that_of_the_key_sphere(rng, monkeypatch):
    """Against Monte Carlo: the localizer is unsure along one direction, and the key sphere is turned and aside."""
    T_key_sphere, T_a_sphere = SE3.from_planar(3.0, -2.0, 1.0), SE3.from_planar(0.4, 0.1, -0.5)
    root = np.diag([0.05, 0.01, 0.02, 0.001, 0.002, 0.02])
    root[1, 0], root[5, 1] = 0.03, 0.005
    located = Localized(0, T_a_sphere, root @ root.T, is_sure=True)
    (edge,) = locate_edges([DriveSphere(Track(7, 100, T_key_sphere), located, lambda: None)])
    found = np.linalg.inv(edge.information)
    errors = SE3.exp(rng.normal(size=(20_000, 6)) @ root.T)
    T_key_a = (T_a_sphere @ T_key_sphere.inverse()).inverse()
    drawn = (
        SE3(T_key_a.matrix[None]) @ SE3(T_a_sphere.matrix[None]) @ errors @ SE3(T_key_sphere.inverse().matrix[None])
    ).log()
    # m from the key sphere: half a hundredth of it, and the least deviations of an edge, 2 mm, 0.5 mrad
    away = np.sqrt(13.0)
    expected = np.cov(drawn.T) + np.diag(np.repeat([0.002 + 0.005 * away, 0.0005], 3) ** 2)
    sigma = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.05)
    fit = SimpleNamespace(T_a_b=T_a_sphere, covariance=root @ root.T)  # by ranges, without that floor
    image = SimpleNamespace(track=Track(7, 100, T_key_sphere), ranges=None)
    monkeypatch.setattr(joining, "find_places", lambda *_: [Place(SimpleNamespace(id=0), image, T_a_sphere)])
    monkeypatch.setattr(joining, "fit_both_ways", lambda *_: (fit, fit))
    monkeypatch.setattr(joining, "reconcile", lambda *_: fit)
    ((edge,), _, _) = joining.refine_by_ranges(None, None, [], lambda _: None)
    by_ranges = np.linalg.inv(edge.information)
    sigma = np.sqrt(np.diagonal(by_ranges))
    np.testing.assert_allclose(by_ranges / np.outer(sigma, sigma), np.cov(drawn.T) / np.outer(sigma, sigma), atol=0.05)


def test_of_two_images_the_nearer_to_the_key_sphere_counts():
    near, far = SE3.from_planar(0.1, 0.0, 0.0), SE3.from_planar(-0.3, 0.0, 0.0)
    images = [
        DriveSphere(Track(k, 100, T), Localized(k, T, 1e-6 * np.eye(6), is_sure=True), lambda: None)
        for k, T in enumerate((far, near, far))
    ]
    assert [edge.a for edge in locate_edges(images)] == [1]
