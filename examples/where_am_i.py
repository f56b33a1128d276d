"""One image in a map: pose, standard deviations, and beside the image what the map shows from there.

python examples/where_am_i.py out/demo/map out/demo/teach where_am_i.png
"""

import argparse
import sys

import matplotlib.pyplot as plt
import numpy as np

import sphere_nav


def main(map_path: str, bag: str, picture: str) -> None:
    """Localise one image, and draw it beside the view of the map."""
    with sphere_nav.open_map(map_path) as town, sphere_nav.Localizer(town) as localizer:
        images = sphere_nav.read_images(bag, image="/cameras/top_front/image_raw")
        _, image, camera = list(images)[:21][-1]
        estimate = localizer.localize(image, camera)
        print(f"{estimate.state} {estimate.reason}")
        if estimate.T_map_camera is None:
            sys.exit(estimate.remedy)
        print("place", estimate.T_map_camera.translation.round(3), "m in the map")
        print("standard deviation", 1000 * np.sqrt(np.diag(estimate.covariance)[:3]).round(4), "mm")
        view = sphere_nav.render(town, camera, estimate.T_map_camera)
    plt.imsave(picture, np.hstack([image, view.image]))


parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
for name in ("map_path", "bag", "picture"):
    parser.add_argument(name)
try:
    main(**vars(parser.parse_args()))
except (OSError, ValueError) as error:
    parser.exit(2, f"{error}\n")
