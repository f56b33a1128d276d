"""One image in a map: pose, standard deviations, and beside the image what the map shows from there.

python examples/where_am_i.py out/demo/map out/demo/teach where_am_i.png
"""

import sys

import cv2
import numpy as np

import sphere_nav

MAP, BAG, PICTURE = sys.argv[1:]

with sphere_nav.open_map(MAP) as town, sphere_nav.Localizer(town) as localizer:
    images = sphere_nav.read_images(BAG, image="/cameras/top_front/image_raw")
    _, image, camera = list(images)[20]
    estimate = localizer.localize(image, camera)
    print(f"{estimate.state} {estimate.reason}")
    if estimate.T_map_camera is None:
        sys.exit(estimate.remedy)
    print("place", estimate.T_map_camera.translation.round(3), "m in the map")
    print("standard deviation", 1000 * np.sqrt(np.diag(estimate.covariance)[:3]).round(4), "mm")
    view = sphere_nav.render(town, camera, estimate.T_map_camera)
cv2.imwrite(PICTURE, np.hstack([image, view.image])[..., ::-1])
