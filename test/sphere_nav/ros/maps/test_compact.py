import tempfile
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import Spherical
from sphere_nav.ros.bags.recorded import serialize_to_store
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.compact import CompactFeatures, CompactSpheres, Spool
from sphere_nav.spheres.appearance.features import SIZE, Features
from sphere_nav.spheres.sphere import Sphere


def test_spheres_come_back_as_they_were_put(rng):
    camera = Spherical(64, 32)
    image = rng.integers(1, 255, (32, 64)).astype(np.uint8)
    range_m = rng.uniform(0.5, 50.0, (32, 64)).astype(np.float32)
    range_m[3, 4:9] = np.nan, np.inf, np.nan, np.inf, 1.0
    spheres = CompactSpheres()
    spheres.keep(serialize_to_store(sphere_to_message(Sphere(image[::-1], range_m, camera, 5), "", 3)))
    spheres.keep(serialize_to_store(sphere_to_message(Sphere(image, range_m, camera, 5), "", 7)))
    assert list(spheres) == [3, 7]
    assert np.array_equal(spheres[3].image, image[::-1])
    found = spheres[7]
    assert np.array_equal(found.image, image)
    assert (found.stamp_ns, found.camera) == (5, camera)
    np.testing.assert_allclose(found.range_m, range_m, rtol=1.1e-4)


def test_features_come_back_as_they_were_put(rng):
    kept, put = CompactFeatures(), {}
    for sphere_id, number in ((7, 5), (3, 0), (9, 2)):
        range_m = rng.uniform(1.0, 9.0, number).astype(np.float32)
        range_m[:1] = np.nan
        rays, descriptors = rng.normal(size=(number, 3)), rng.integers(0, 256, (number, SIZE))
        put[sphere_id] = Features(rays.astype(np.float32), range_m, descriptors.astype(np.uint8))
        kept[sphere_id] = put[sphere_id]
    assert list(kept) == [7, 3, 9]
    for sphere_id, features in kept.items():
        assert len(features) == len(put[sphere_id])
        for name in ("rays", "range_m", "descriptors"):
            np.testing.assert_array_equal(getattr(features, name), getattr(put[sphere_id], name))
    del kept[3]
    assert sorted(kept) == [7, 9]


def test_the_last_that_was_added_holds():
    spool = Spool(bytes)
    for sphere_id, data in ((7, b"one"), (3, b""), (9, bytes(1 << 20)), (7, b"four")):
        spool.add(sphere_id, data)
    assert dict(spool) == {7: b"four", 3: b"", 9: bytes(1 << 20)}


def test_a_disk_that_is_full_says_where():
    spool = Spool(bytes)

    def write(data):
        raise OSError(28, "No space left on device")

    file, spool._file = spool._file, SimpleNamespace(seek=lambda *where: 0, write=write)
    with pytest.raises(OSError, match="No space left") as error:
        spool.add(1, b"one")
    assert error.value.filename == tempfile.gettempdir()
    assert len(spool) == 0
    file.close()
