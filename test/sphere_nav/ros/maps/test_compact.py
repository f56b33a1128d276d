from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import Spherical
from sphere_nav.ros.bags.serialization import serialize_to_store
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
    spheres.add(serialize_to_store(sphere_to_message(Sphere(image[::-1], range_m, camera, 5), "", 3)))
    spheres.add(serialize_to_store(sphere_to_message(Sphere(image, range_m, camera, 5), "", 7)))
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


def test_what_was_added_comes_back_in_order_also_while_more_is_added(tmp_path):
    spool = Spool(tmp_path)
    assert [spool.add(data) for data in (b"one", b"", b"three")] == [0, 1, 2]
    found = iter(spool)
    assert next(found) == b"one"
    spool.add(b"four")
    assert list(found) == [b"", b"three"]
    assert list(spool) == [b"one", b"", b"three", b"four"]
    assert len(spool) == 4
    assert spool[2] == b"three"
    with pytest.raises(IndexError, match="below 4, found 4"):
        spool[4]
    spool.add(bytes(1 << 20))
    assert list(tmp_path.iterdir()) == []  # nothing is left in the folder
    spool.close()


def test_a_disk_that_is_full_says_where(tmp_path, monkeypatch):
    spool = Spool(tmp_path)

    def write(data):
        raise OSError(28, "No space left on device")

    file, spool._file = spool._file, SimpleNamespace(seek=lambda *where: None, write=write)
    with pytest.raises(OSError, match="No space left") as error:
        spool.add(b"one")
    assert error.value.filename == str(tmp_path)
    assert len(spool) == 0
    file.close()
