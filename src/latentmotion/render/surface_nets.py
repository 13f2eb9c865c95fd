"""Naive surface nets (Gibson 1998): where a function on a grid is zero, as a mesh of quads.

One vertex in each cell that the surface crosses: the mean of the crossings on the cell's 12 edges.
One quad around each crossed edge of the grid, through the four cells that share it.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from jaxtyping import Float, Int


def surface_net(
    values: Float[np.ndarray, "x y z"],
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "quads 4"]]:
    """Finds the surface between negative values, inside, and positive ones.

    Args:
        values: Positive all around the edge of the grid.

    Returns:
        Vertices in steps of the grid, and the corners of the quads, counterclockwise from outside.
    """
    steps, n = np.eye(3, dtype=int), np.array(values.shape) - 1
    total, count = np.zeros((*n, 3)), np.zeros(n)
    for axis, (u, v) in product(range(3), product((0, 1), repeat=2)):  # the 12 edges of each cell
        first = np.insert((u, v), axis, 0)
        a, b = (
            values[tuple(slice(c, m + c) for c, m in zip(corner, n, strict=True))]
            for corner in (first, first + steps[axis])
        )
        crossed = (a < 0) != (b < 0)
        total += crossed[..., None] * first
        total[..., axis] += np.where(crossed, a / np.where(crossed, a - b, 1), 0)
        count += crossed
    cells = np.stack(np.meshgrid(*[np.arange(m) for m in n], indexing="ij"), axis=-1)
    with np.errstate(invalid="ignore"):
        vertices = cells + total / np.where(count > 0, count, np.nan)[..., None]
    crossed = np.isfinite(vertices[..., 0])
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(crossed.sum())
    quads, inside = [], values < 0
    for axis in range(3):  # the four cells around each crossed edge of the grid
        ahead = np.roll(inside, -1, axis)
        ahead[tuple(slice(-1, None) if a == axis else slice(None) for a in range(3))] = False
        edges = np.argwhere(inside != ahead)
        outward = inside[tuple(edges.T)]
        second, third = steps[[(axis + 1) % 3, (axis + 2) % 3]]
        around = [edges - second - third, edges - third, edges, edges - second]
        ring = np.stack([number[tuple(cell.T)] for cell in around], axis=-1)
        quads.append(np.where(outward[:, None], ring, ring[:, ::-1]))
    return vertices[crossed], np.concatenate(quads)
