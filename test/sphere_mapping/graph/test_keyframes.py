from dataclasses import dataclass

import numpy as np

from sphere_mapping.graph import keyframes
from sphere_mapping.graph.keyframes import why_key_sphere
from sphere_mapping.params import KeySphereParams
from sphere_nav.geometry import SE3
from sphere_nav.photometric import Alignment


@dataclass
class Reference:
    coverage: float = 0.8
    median_range: float = 5.0
    is_whole: bool = False


def alignment(mad=4.0, overlap=0.75, inlier_share=0.9):
    return Alignment(SE3.identity(), np.eye(6), "", 5, 1000, overlap, inlier_share, mad, 0.9, (1.0,), (0.0,))


def moved(distance):
    return SE3.from_parts(np.eye(3), [distance, 0.0, 0.0])


def test_the_reason_for_a_key_sphere():
    for found, distance, reason in [
        (alignment(mad=12.7), 0.1, keyframes.NOT_YET),
        (alignment(mad=12.8), 0.1, keyframes.MAD),
        (alignment(overlap=0.47), 0.1, keyframes.OVERLAP),
        (alignment(inlier_share=0.4), 0.1, keyframes.INLIERS),
        (alignment(), 0.99, keyframes.NOT_YET),
        (alignment(), 1.01, keyframes.PARALLAX),
    ]:
        params = KeySphereParams(max_parallax=0.2)
        assert why_key_sphere(found, moved(distance), Reference(), params) == reason


def test_a_whole_sphere_is_kept_for_longer():
    whole = Reference(is_whole=True)
    assert why_key_sphere(alignment(), moved(4.9), whole, KeySphereParams()) == keyframes.NOT_YET
    assert why_key_sphere(alignment(), moved(5.1), whole, KeySphereParams()) == keyframes.PARALLAX
