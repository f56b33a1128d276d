"""The motion between two key spheres of a map, each taken for an RGB-D image of the world around it.

python examples/motion_between.py out/demo/map motion_between.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import sphere_nav


def main(map_path: str, picture: str) -> None:
    """Register the first two key spheres, and draw both."""
    with sphere_nav.open_map(map_path) as town:
        first, second = sorted(town.graph.nodes)[:2]
        a, b = town.load_sphere(first), town.load_sphere(second)
        known = town.graph[first].T_map_sphere.inverse() @ town.graph[second].T_map_sphere
    found = sphere_nav.register(a, b)
    metres, radians = known.distance(found.T_a_b)
    print("converged" if found.is_converged else f"refused: {found.reason}")
    print(f"moved by {found.T_a_b.translation.round(3)} m; the map says the same to {1000 * metres:.1f} mm,", end=" ")
    print(f"{np.degrees(radians):.2f} deg")
    plt.imsave(picture, np.vstack([a.image, b.image]))


parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
for name in ("map_path", "picture"):
    parser.add_argument(name)
try:
    main(**vars(parser.parse_args()))
except (OSError, ValueError) as error:
    parser.exit(2, f"{error}\n")
