"""Rotations as quaternions (w, x, y, z), matrices, axis-angle, Euler angles and 6D: pure functions.

Every function takes NumPy and PyTorch arrays alike, batch dimensions first, in the array's own
precision. Matrices act on column vectors from the left; angles are radians.
6D: Zhou et al., "On the Continuity of Rotation Representations in Neural Networks", CVPR 2019.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, Literal

from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.errors import InputError

# The two vectors of a matrix that its 6D form keeps: HumanML3D's columns or PyTorch3D's rows.
Layout = Literal["columns", "rows"]

# Below this squared sine or angle the Taylor series is exact to the last bit.
_SMALL = 1e-8


def quaternion_multiply(
    a: Float[Any, "*#batch 4"], b: Float[Any, "*#batch 4"]
) -> Float[Any, "*batch 4"]:
    """Returns the product `a b`: the rotation `b` followed by the rotation `a`."""
    xp = array_namespace(a, b)
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - xp.sum(av * bv, axis=-1, keepdims=True)
    return xp.concat([w, aw * bv + bw * av + _cross(av, bv)], axis=-1)


def quaternion_conjugate(q: Float[Any, "*batch 4"]) -> Float[Any, "*batch 4"]:
    """Returns the inverse of unit quaternions."""
    xp = array_namespace(q)
    return xp.concat([q[..., :1], -q[..., 1:]], axis=-1)


def quaternion_rotate(
    q: Float[Any, "*#batch 4"], v: Float[Any, "*#batch 3"]
) -> Float[Any, "*batch 3"]:
    """Turns vectors by unit quaternions."""
    w, axis = q[..., :1], q[..., 1:]
    twice = 2 * _cross(axis, v)
    return v + w * twice + _cross(axis, twice)


def quaternion_between(
    a: Float[Any, "*#batch 3"], b: Float[Any, "*#batch 3"]
) -> Float[Any, "*batch 4"]:
    """Returns the shortest rotation that takes the direction of `a` to that of `b`.

    Opposite directions have no shortest rotation; they get a half turn about an axis
    perpendicular to `a`. A vector of length zero gives the identity.
    """
    xp = array_namespace(a, b)
    length = xp.sqrt(xp.sum(a * a, axis=-1) * xp.sum(b * b, axis=-1))[..., None]
    w = length + xp.sum(a * b, axis=-1, keepdims=True)
    opposite = w <= length * 1e-6
    # A perpendicular vector: the cross product with the axis, x or y, that `a` is farther from.
    x, y, z = ((a + 0 * b)[..., n] for n in range(3))
    with_x = xp.stack([0 * x, z, -y], axis=-1)
    with_y = xp.stack([-z, 0 * y, x], axis=-1)
    perpendicular = xp.where((abs(x) > abs(y))[..., None], with_y, with_x)
    axis = xp.where(opposite, perpendicular, _cross(a, b))
    w = xp.where(opposite, xp.where(length > 0, 0 * w, 1 + 0 * w), w)
    return _normalize(xp.concat([w, axis], axis=-1))


def matrix_between(
    a: Float[Any, "*#batch 3"], b: Float[Any, "*#batch 3"]
) -> Float[Any, "*batch 3 3"]:
    """Returns the shortest rotation that takes one direction to another, as a matrix."""
    return matrix_from_quaternion(quaternion_between(a, b))


def quaternion_from_matrix(m: Float[Any, "*batch 3 3"]) -> Float[Any, "*batch 4"]:
    """Turns rotation matrices into unit quaternions with the largest component positive."""
    xp = array_namespace(m)
    # The rows of 4 q qᵀ; the one with the largest diagonal entry is q without cancellation.
    (a, b, c), (d, e, f), (g, h, i) = [[m[..., r, s] for s in range(3)] for r in range(3)]
    rows = [
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ]
    best, largest = rows[0], rows[0][0]
    for n, row in enumerate(rows[1:], start=1):
        larger = row[n] > largest
        largest = xp.where(larger, row[n], largest)
        best = [xp.where(larger, new, old) for new, old in zip(row, best, strict=True)]
    return _normalize(xp.stack(best, axis=-1))


def matrix_from_quaternion(q: Float[Any, "*batch 4"]) -> Float[Any, "*batch 3 3"]:
    """Turns unit quaternions into rotation matrices."""
    xp = array_namespace(q)
    w, x, y, z = (q[..., n] for n in range(4))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_axis_angle(v: Float[Any, "*batch 3"]) -> Float[Any, "*batch 4"]:
    """Turns rotation vectors (axis times angle) into unit quaternions."""
    xp = array_namespace(v)
    square = xp.sum(v * v, axis=-1, keepdims=True)
    small = square < _SMALL
    angle = xp.sqrt(xp.where(small, 1 + 0 * square, square))
    w = xp.where(small, 1 - square / 8, xp.cos(angle / 2))
    return xp.concat(
        [w, v * xp.where(small, 0.5 - square / 48, xp.sin(angle / 2) / angle)], axis=-1
    )


def matrix_from_axis_angle(v: Float[Any, "*batch 3"]) -> Float[Any, "*batch 3 3"]:
    """Turns rotation vectors (axis times angle) into rotation matrices."""
    return matrix_from_quaternion(quaternion_from_axis_angle(v))


def axis_angle_from_matrix(m: Float[Any, "*batch 3 3"]) -> Float[Any, "*batch 3"]:
    """Turns rotation matrices into rotation vectors with angles from 0 to π."""
    xp = array_namespace(m)
    q = quaternion_from_matrix(m)
    q = xp.where(q[..., :1] < 0, -q, q)
    square = xp.sum(q[..., 1:] ** 2, axis=-1, keepdims=True)
    small = square < _SMALL
    sine = xp.sqrt(xp.where(small, 1 + 0 * square, square))
    return q[..., 1:] * xp.where(small, 2 + square / 3, 2 * xp.atan2(sine, q[..., :1]) / sine)


def matrix_from_euler(angles: Float[Any, "*batch axes"], order: str) -> Float[Any, "*batch 3 3"]:
    """Turns intrinsic Euler angles, as in BVH, into rotation matrices.

    Args:
        angles: Radians, in the order of `order`.
        order: One letter of XYZ per angle; "ZXY" means `Z(angles[0]) X(angles[1]) Y(angles[2])`.

    Raises:
        InputError: `order` has another letter, or not one letter per angle.
    """
    xp = array_namespace(angles)
    if not order or set(order) - set("XYZ") or len(order) != angles.shape[-1]:
        raise InputError(
            f"rotation order {order!r} for {angles.shape[-1]} angles; "
            "expected one of the letters X, Y, Z per angle, for example 'ZXY'"
        )
    matrices = []
    for n, axis in enumerate(order):
        angle = angles[..., n]
        c, s, ones, zeros = xp.cos(angle), xp.sin(angle), 1 + 0 * angle, 0 * angle
        rows = {
            "X": [[ones, zeros, zeros], [zeros, c, -s], [zeros, s, c]],
            "Y": [[c, zeros, s], [zeros, ones, zeros], [-s, zeros, c]],
            "Z": [[c, -s, zeros], [s, c, zeros], [zeros, zeros, ones]],
        }[axis]
        matrices.append(xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2))
    return reduce(xp.matmul, matrices)


def euler_from_matrix(m: Float[Any, "*batch 3 3"], order: str) -> Float[Any, "*batch 3"]:
    """Turns rotation matrices into intrinsic Euler angles; the inverse of `matrix_from_euler`.

    The middle angle is from -π/2 to π/2. Where it is at its end (gimbal lock) the last one is 0.

    Raises:
        InputError: `order` is not a permutation of XYZ.
    """
    xp = array_namespace(m)
    if sorted(order) != ["X", "Y", "Z"]:
        raise InputError(f"rotation order {order!r}; expected a permutation of 'XYZ'")
    i, j, k = ("XYZ".index(axis) for axis in order)
    sign = 1 if (j - i) % 3 == 1 else -1
    cosine = xp.sqrt(m[..., i, i] ** 2 + m[..., i, j] ** 2)
    locked = cosine < 1e-6
    first = xp.where(
        locked,
        xp.atan2(sign * m[..., k, j], m[..., j, j]),
        xp.atan2(-sign * m[..., j, k], m[..., k, k]),
    )
    last = xp.atan2(-sign * m[..., i, j], m[..., i, i])
    middle = xp.atan2(sign * m[..., i, k], cosine)
    return xp.stack([first, middle, xp.where(locked, 0 * last, last)], axis=-1)


def sixd_from_matrix(m: Float[Any, "*batch 3 3"], layout: Layout) -> Float[Any, "*batch 6"]:
    """Keeps the first two columns, or rows, of rotation matrices, one after the other."""
    xp = array_namespace(m)
    pair = [m[..., n] if layout == "columns" else m[..., n, :] for n in (0, 1)]
    return xp.concat(pair, axis=-1)


def matrix_from_sixd(s: Float[Any, "*batch 6"], layout: Layout) -> Float[Any, "*batch 3 3"]:
    """Turns two vectors, not parallel, into matrices by Gram-Schmidt; the second gives way."""
    xp = array_namespace(s)
    first = _normalize(s[..., :3])
    third = _normalize(_cross(first, s[..., 3:]))
    axis = -1 if layout == "columns" else -2
    return xp.stack([first, _cross(third, first), third], axis=axis)


def slerp(
    a: Float[Any, "*#batch 4"], b: Float[Any, "*#batch 4"], t: Float[Any, "*#batch"] | float
) -> Float[Any, "*batch 4"]:
    """Goes the short way from `a` (t = 0) to `b` (t = 1) at constant angular speed."""
    xp = array_namespace(a, b)
    cosine = xp.sum(a * b, axis=-1, keepdims=True)
    b = xp.where(cosine < 0, -b, b)
    cosine = abs(cosine)
    near = cosine > 1 - 1e-6
    angle = xp.acos(xp.where(near, 0 * cosine, cosine))
    t = (xp.asarray(t, dtype=a.dtype, device=device(a)) + 0 * cosine[..., 0])[..., None]
    weight_a = xp.where(near, 1 - t, xp.sin((1 - t) * angle) / xp.sin(angle))
    weight_b = xp.where(near, t, xp.sin(t * angle) / xp.sin(angle))
    return _normalize(weight_a * a + weight_b * b)


def continuous_quaternions(q: Float[Any, "frames *batch 4"]) -> Float[Any, "frames *batch 4"]:
    """Chooses the sign of each quaternion, along the first axis, nearest to the one before it."""
    xp = array_namespace(q)
    flips = xp.astype(xp.sum(q[1:] * q[:-1], axis=-1, keepdims=True) < 0, xp.int64)
    odd = xp.cumulative_sum(flips, axis=0) % 2 == 1
    return xp.concat([q[:1], xp.where(odd, -q[1:], q[1:])], axis=0)


def _cross(a: Float[Any, "*#batch 3"], b: Float[Any, "*#batch 3"]) -> Float[Any, "*batch 3"]:
    xp = array_namespace(a, b)
    (ax, ay, az), (bx, by, bz) = ([v[..., n] for n in range(3)] for v in (a, b))
    return xp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _normalize(v: Float[Any, "*batch n"]) -> Float[Any, "*batch n"]:
    xp = array_namespace(v)
    return v / xp.sqrt(xp.sum(v * v, axis=-1, keepdims=True))
