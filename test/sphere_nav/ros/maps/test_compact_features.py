import numpy as np

from sphere_nav.ros.maps.compact import CompactFeatures
from sphere_nav.spheres.appearance.features import SIZE, Features


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
