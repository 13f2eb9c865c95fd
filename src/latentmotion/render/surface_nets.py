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
    places = _cell_vertices(values)
    crossed = np.isfinite(places[..., 0])
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(crossed.sum())
    return places[crossed], np.concatenate([_quads(values, number, axis) for axis in range(3)])


def _cell_vertices(values: Float[np.ndarray, "x y z"]) -> Float[np.ndarray, "u v w 3"]:
    """Returns the mean of the crossings on the 12 edges of each cell, NaN where there are none."""
    n = np.array(values.shape) - 1
    total, count = np.zeros((*n, 3)), np.zeros(n)
    for axis, (u, v) in product(range(3), product((0, 1), repeat=2)):
        first = np.insert((u, v), axis, 0)
        a, b = (_corner(values, first + step) for step in (0 * first, np.eye(3, dtype=int)[axis]))
        crossed = (a < 0) != (b < 0)
        total += crossed[..., None] * first
        total[..., axis] += np.where(crossed, a / np.where(crossed, a - b, 1), 0)
        count += crossed
    base = np.stack(np.meshgrid(*[np.arange(m) for m in n], indexing="ij"), axis=-1)
    with np.errstate(invalid="ignore"):
        return base + total / np.where(count > 0, count, np.nan)[..., None]


def _corner(
    values: Float[np.ndarray, "x y z"], corner: Int[np.ndarray, " width"]
) -> Float[np.ndarray, "u v w"]:
    """Returns the values at one corner of every cell."""
    return values[tuple(slice(c, n - 1 + c) for c, n in zip(corner, values.shape, strict=True))]


def _quads(
    values: Float[np.ndarray, "x y z"], number: Int[np.ndarray, "u v w"], axis: int
) -> Int[np.ndarray, "quads 4"]:
    """Joins the four cells around each crossed grid edge along one axis."""
    inside = values < 0
    ahead = np.roll(inside, -1, axis)
    ahead[tuple(slice(-1, None) if a == axis else slice(None) for a in range(3))] = False
    edges = np.argwhere(inside != ahead)
    outward = inside[tuple(edges.T)]
    second, third = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
    around = [edges - second - third, edges - third, edges, edges - second]
    ring = np.stack([number[tuple(cell.T)] for cell in around], axis=-1)
    return np.where(outward[:, None], ring, ring[:, ::-1])
