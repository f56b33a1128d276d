"""Views from along the taught path, half a metre to the left of it: what a camera would see that was never there.

python examples/fly_along.py out/demo/map fly_along.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import sphere_nav


def main(map_path: str, picture: str) -> None:
    """Draw nine views along the path."""
    camera = sphere_nav.Camera.from_fx(width=320, height=240, fx=220)
    look_ahead = sphere_nav.SE3.from_parts(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), [0, 0.5, 0])
    rows = []
    with sphere_nav.open_map(map_path) as town:
        spheres = [town.graph[number].T_map_sphere for number in sorted(town.graph.nodes)]
        for row in np.array_split(np.linspace(0, len(spheres) - 1, 9).astype(int), 3):
            views = [sphere_nav.render(town, camera, spheres[k] @ look_ahead) for k in row]
            print([f"{100 * view.is_known.mean():.0f} % seen" for view in views])
            rows.append(np.hstack([view.image for view in views]))
    plt.imsave(picture, np.vstack(rows))


parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
for name in ("map_path", "picture"):
    parser.add_argument(name)
try:
    main(**vars(parser.parse_args()))
except (OSError, ValueError) as error:
    parser.exit(2, f"{error}\n")
