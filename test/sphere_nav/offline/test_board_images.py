"""Images of one instant are found by their names."""

import cv2
import numpy as np

from sphere_nav.offline.board_images import find_images


def test_images_pair_by_name_or_by_number(tmp_path):
    for name in ("cam0/0", "cam0/1", "cam1/right0", "cam1/right1"):
        path = tmp_path / f"{name}.png"
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), np.zeros((48, 64), dtype=np.uint8))
    found = find_images([str(tmp_path / "cam0"), str(tmp_path / "cam1")])
    assert set(found["cam0"]) == set(found["cam1"]) == {"0", "1"}
