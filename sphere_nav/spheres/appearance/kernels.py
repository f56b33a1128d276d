"""How well parts of a view agree with a panorama at every heading: compiled, as every pixel meets every heading."""

from sphere_nav.kernel_cache.kernels import OPTIONS, njit


@njit(**OPTIONS)
def score_turns(row, column, direction, cell, reach, panorama, scores):
    """Add the products of directions to scores (cells, 2 reach + 1, W) f32: of each pixel, its cell, each turn.

    row, column (N,) i32 in the panorama (2, H, W) f32 at turn 0, direction (N, 2) f32. A turn by `s` columns is `s`
    further right, and around. Rows beyond it add 0.
    """
    height, width = panorama.shape[1], panorama.shape[2]
    for k in range(column.size):
        du, dv, start = direction[k, 0], direction[k, 1], column[k]
        for i in range(2 * reach + 1):
            y = row[k] + i - reach
            if 0 <= y < height:
                along, across, own = panorama[0, y], panorama[1, y], scores[cell[k], i]
                for s in range(width - start):
                    own[s] += du * along[start + s] + dv * across[start + s]
                for s in range(start):
                    own[width - start + s] += du * along[s] + dv * across[s]
