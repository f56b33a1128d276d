from sphere_mapping.graph import keyframes
from sphere_mapping.graph.keyframes import MapUpdate
from sphere_nav.geometry import SE3


def test_a_sphere_with_a_reason_is_a_key_sphere():
    assert not MapUpdate(1, SE3.identity()).is_key
    assert MapUpdate(1, SE3.identity(), key_reason=keyframes.FIRST).is_key
