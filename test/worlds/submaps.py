"""Drives as mapping has them: key spheres in a frame of their own, and the images that they are."""

from functools import partial
from itertools import pairwise

import numpy as np

from sphere_mapping.experiences.joining import DriveSphere
from sphere_mapping.graph.extension import Submap
from sphere_mapping.graph.keyframes import Track
from sphere_nav.geometry import SE3
from sphere_nav.spheres.appearance.features import SIZE, Features
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

NOTHING = Features(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros((0, SIZE), np.uint8))


def submap_of(load, poses, first_id, T=None):
    """Return a graph in a frame of its own, moved by `T`; `load` gives the sphere of a number, features say nothing."""
    moved = [(T or SE3.identity()) @ pose for pose in poses]
    nodes = [KeySphere(first_id + k, k, pose, region_radius_m=2.0) for k, pose in enumerate(moved)]
    edges = [Edge(a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere, 1e5 * np.eye(6)) for a, b in pairwise(nodes)]
    index = AppearanceIndex()
    for node in nodes:
        index.add(node.id, NOTHING)
    return Submap(SphereGraph(nodes, edges), index, lambda one: load(one - first_id))


def images_of(drive, located=None):
    """Return the key spheres of a drive as its images, some of them located."""
    found = located or {}
    tracks = [Track(node.stamp_ns, node.id, SE3.identity()) for node in drive.graph]
    return [DriveSphere(one, found.get(one.key_id), partial(drive.load, one.key_id)) for one in tracks]
