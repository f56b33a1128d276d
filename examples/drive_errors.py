"""A recorded drive localised in a map by one camera, against the truth of the simulator: errors along the way.

python examples/drive_errors.py out/demo/map out/demo/teach drive_errors.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import sphere_nav


def main(map_path: str, bag: str, picture: str) -> None:
    """Localise the drive, print the errors, and draw each pose by the standard deviation it told."""
    estimate = sphere_nav.localize_bag(map_path, bag, image="/cameras/top_front/image_raw")
    truth = sphere_nav.read_trajectory(bag)
    report = sphere_nav.evaluate(estimate, truth, alignment="se3")
    print(f"{report['n']} poses with a truth")
    for name in ("translation_m", "rotation_deg", "lateral_m"):
        print(f"{name:<14} median {report[name]['median']:.4f}, max {report[name]['max']:.4f}")
    xyz = estimate.T_map_body.translation
    sigma = np.sqrt(np.trace(estimate.covariances[:, :3, :3], axis1=1, axis2=2))
    dots = plt.scatter(xyz[:, 0], xyz[:, 1], c=1000 * sigma, cmap="cividis")
    plt.colorbar(dots, label="standard deviation told, mm")
    plt.axis("equal")
    plt.title(f"{len(xyz)} poses in the map, m")
    plt.savefig(picture)


parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
for name in ("map_path", "bag", "picture"):
    parser.add_argument(name)
try:
    main(**vars(parser.parse_args()))
except (OSError, ValueError) as error:
    parser.exit(2, f"{error}\n")
