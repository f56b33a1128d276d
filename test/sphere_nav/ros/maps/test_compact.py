import numpy as np
import pytest

from sphere_nav.geometry import Spherical
from sphere_nav.ros.bags.serialization import serialize_to_store
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.compact import CompactSpheres
from sphere_nav.spheres.sphere import Sphere


def test_spheres_come_back_as_they_were_put(rng):
    camera = Spherical(64, 32)
    image = rng.integers(1, 255, (32, 64)).astype(np.uint8)
    range_m = rng.uniform(0.5, 50.0, (32, 64)).astype(np.float32)
    range_m[3, 4:9] = np.nan, np.inf, np.nan, np.inf, 1.0
    spheres = CompactSpheres()
    spheres.add(serialize_to_store(sphere_to_message(Sphere(image[::-1], range_m, camera, 5), "", 3)))
    spheres.add(serialize_to_store(sphere_to_message(Sphere(image, range_m, camera, 5), "", 7)))
    assert list(spheres) == [3, 7]
    assert np.array_equal(spheres[3].image, image[::-1])
    found = spheres[7]
    assert np.array_equal(found.image, image)
    assert (found.stamp_ns, found.camera) == (5, camera)
    np.testing.assert_allclose(found.range_m, range_m, rtol=1.1e-4)


def test_what_is_no_sphere_is_refused_when_it_is_put():
    message = sphere_to_message(Sphere(np.ones((4, 8), np.uint8), np.ones((4, 8), np.float32), Spherical(8, 4)), "")
    message.image = message.image[:-1]
    with pytest.raises(ValueError, match="image: expected 32 bytes"):
        CompactSpheres().add(serialize_to_store(message))
    with pytest.raises(ValueError, match="expected sphere_nav_msgs/msg/AugmentedSphere"):
        CompactSpheres().add(b"nothing of the kind")
