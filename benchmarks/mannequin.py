"""Makes the mannequin: the one body of all files, pages and pictures, in `render/mannequin.json`.

    python -m benchmarks.mannequin

Each part is a loft: rings of superellipses along an axis, closed by rounded caps,

    p(s, a) = axis(s) + u ru |cos a|^(2/n) sign(cos a) + v rv |sin a|^(2/n) sign(sin a),

with rv of its own in front and behind. Sizes are meters on the body of a generated motion in a
T-pose: y is up, z ahead, x to its left. Left parts are mirrored. A part moves with one joint; the
waist and the neck, which bend, share their vertices out between the joints above and below. The
parts are listed in `mannequin.toml`.
"""

from __future__ import annotations

import base64
import json
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.skeleton import HUMANML3D

ASSET = Path(__file__).parents[1] / "src/latentmotion/render/mannequin.json"
STEP = 1e-4  # Meters of a step of the stored positions.

# Joints of the body, meters.
REST = {
    **{"pelvis": (0, 0, 0), "left_hip": (0.077, -0.072, 0), "left_knee": (0.125, -0.461, 0)},
    **{"left_ankle": (0.147, -0.890, 0), "left_foot": (0.147, -0.953, 0.132)},
    **{"spine1": (0, 0.132, 0), "spine2": (0, 0.275, 0), "spine3": (0, 0.333, 0)},
    **{"neck": (0, 0.550, 0), "head": (0, 0.650, 0.015), "left_collar": (0.139, 0.327, 0)},
    **{"left_shoulder": (0.266, 0.327, 0), "left_elbow": (0.526, 0.327, 0)},
    "left_wrist": (0.793, 0.327, 0),
}

# Place along the axis; radius along u, along v in front and behind; shift along u and along v.
Station = Sequence[float]


@dataclass(frozen=True)
class Part:
    """A closed or open surface that moves with a joint, or between the joints of a chain."""

    joints: tuple[str, ...]  # One joint, or a chain from below.
    anchor: tuple[str, str]  # Ends of the bone along which it is stretched on other bodies.
    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    accent: bool = False  # Whether it has the color of its take.

    def mirrored(self) -> Part:
        """Returns the part of the right side."""
        right = [name.replace("left_", "right_") for name in (*self.joints, *self.anchor)]
        return replace(
            self,
            joints=tuple(right[:-2]),
            anchor=(right[-2], right[-1]),
            vertices=self.vertices * (-1, 1, 1),
            triangles=self.triangles[:, ::-1],
        )


def loft(
    start: Sequence[float],
    along: Sequence[float],
    u: Sequence[float],
    stations: Sequence[Station],
    caps: tuple[float, float],
    sides: int,
    rings: int,
    power: float = 2.0,
    bend: int = 2,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns vertices and triangles of a loft.

    Args:
        start: Where the axis begins.
        along: Its direction.
        u: First axis of the rings; the second, v, is along × u.
        stations: At least two, in order.
        caps: Depth of the rounded ends.
        sides: Vertices of a ring.
        rings: Rings between the ends.
        power: n of the superellipses; 2 are ellipses, more are boxes.
        bend: Rings of each rounded end.
    """
    rows = np.array([(*station, *(0.0,) * (6 - len(station))) for station in stations])
    places = np.linspace(rows[0, 0], rows[-1, 0], rings)
    shape = smooth(places, rows)
    turn = (np.arange(bend) + 1) * np.pi / 2 / (bend + 1)
    first = [(places[0] - caps[0] * np.cos(a), shape[0], np.sin(a)) for a in turn]
    last = [(places[-1] + caps[1] * np.cos(a), shape[-1], np.sin(a)) for a in turn[::-1]]
    middle = [(place, row, 1.0) for place, row in zip(places, shape, strict=True)]
    axis, u = np.array(along) / np.linalg.norm(along), np.array(u, float)
    u = u - axis * (axis @ u)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angles = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    cos, sin = (np.sign(f) * np.abs(f) ** (2 / power) for f in (np.cos(angles), np.sin(angles)))
    points = [np.array(start) + axis * (places[0] - caps[0]) + shape[0, 3] * u + shape[0, 4] * v]
    for place, (ru, front, back, du, dv), size in (*first, *middle, *last):
        across = size * np.where(sin > 0, front, back) * sin + dv
        ring = np.array(start) + axis * place + np.outer(size * ru * cos + du, u)
        points.extend(ring + np.outer(across, v))
    points.append(
        np.array(start) + axis * (places[-1] + caps[1]) + shape[-1, 3] * u + shape[-1, 4] * v
    )
    count, faces = rings + 2 * bend, []
    for side in range(sides):
        after = (side + 1) % sides
        faces.append((0, 1 + after, 1 + side))
        faces.append(
            (len(points) - 1, len(points) - 1 - sides + side, len(points) - 1 - sides + after)
        )
        for below, above in pairwise(range(count)):
            a, b = (1 + below * sides + k for k in (side, after))
            c, d = (1 + above * sides + k for k in (side, after))
            faces += [(a, b, d), (a, d, c)]
    return np.array(points), np.array(faces)


def smooth(places: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Returns the stations' columns at other places, along a cubic Hermite curve."""
    at, values = rows[:, 0], rows[:, 1:]
    slope = np.gradient(values, at, axis=0)
    k = np.clip(np.searchsorted(at, places, side="right") - 1, 0, len(at) - 2)
    width = (at[k + 1] - at[k])[:, None]
    t = (places - at[k])[:, None] / width
    h = (2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t, 3 * t**2 - 2 * t**3, t**3 - t**2)
    return (
        h[0] * values[k]
        + h[1] * width * slope[k]
        + h[2] * values[k + 1]
        + h[3] * width * slope[k + 1]
    )


def ball(center: Sequence[float], radius: float, sides: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Returns a sphere."""
    angles = np.linspace(0, np.pi, sides // 2 + 1)[1:-1]
    turns = 2 * np.pi * np.arange(sides) / sides
    rings = [
        (np.sin(a) * np.cos(t), np.cos(a), np.sin(a) * np.sin(t)) for a in angles for t in turns
    ]
    points = np.array([(0, 1, 0), *rings, (0, -1, 0)]) * radius + np.array(center)
    faces, end = [], len(points) - 1
    for side in range(sides):
        after = (side + 1) % sides
        faces += [(0, 1 + after, 1 + side), (end, end - sides + side, end - sides + after)]
        for ring in range(len(angles) - 1):
            a, b = (1 + ring * sides + k for k in (side, after))
            faces += [(a, b, b + sides), (a, b + sides, a + sides)]
    return points, np.array(faces)


# Parts of the middle and the left side.
PARTS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))["parts"]

# Stations of the head, on which the face lies.
HEAD: list[Station] = next(row["stations"] for row in PARTS if row["joints"] == ["head"])


def face() -> tuple[np.ndarray, np.ndarray]:
    """Returns the plane of the face: a plate on the front of the head."""
    columns, rows = 9, 7
    across = np.linspace(-1, 1, columns)
    up = np.linspace(-1, 1, rows)
    x, y = np.meshgrid(across, up)
    # A rounded rectangle, narrower at the chin, whose rim goes into the head.
    x, y = x * np.sqrt(1 - 0.30 * y**2), y * np.sqrt(1 - 0.30 * x**2)
    wide = 0.055 + 0.009 * y
    heights = 0.706 + 0.056 * y
    ru, front, _ = smooth(heights.ravel(), np.array(HEAD)).T.reshape(3, rows, columns)
    place = x * wide
    out = front * np.sqrt(np.maximum(1 - (place / ru) ** 2, 0.05))
    rim = np.maximum(np.abs(np.broadcast_to(across, (rows, columns))), np.abs(up)[:, None])
    lift = np.where(rim > 0.99, 0.0015, 0.005)
    points = np.stack([place, heights, 0.022 + out + lift], -1).reshape(-1, 3)
    faces = []
    for row in range(rows - 1):
        for column in range(columns - 1):
            a = row * columns + column
            faces += [(a, a + 1, a + columns + 1), (a, a + columns + 1, a + columns)]
    return points, np.array(faces)


def parts() -> Iterator[Part]:
    """Yields the parts of the middle and the left side."""
    for row in PARTS:
        if "axis" in row:
            surface = loft(**row["axis"], stations=row["stations"], **row["rings"])
        else:
            surface = ball(**row["ball"]) if "ball" in row else face()
        first, last = row["anchor"]
        yield Part(tuple(row["joints"]), (first, last), *surface, row.get("accent", False))


def whole() -> list[Part]:
    """Returns all parts, those of the take's color last."""
    found = []
    for part in parts():
        found.append(part)
        if any(name.startswith("left_") for name in part.joints):
            found.append(part.mirrored())
    return sorted(found, key=lambda part: part.accent)


def main() -> None:
    """Writes the asset."""
    body, names = whole(), HUMANML3D.names
    rest = {
        name: REST.get(name) or _mirrored(REST[name.replace("right", "left")]) for name in names
    }
    vertices, triangles, joints, shares, anchors, places = [], [], [], [], [], []
    start = 0
    for part in body:
        vertices.append(part.vertices)
        triangles.append(part.triangles + start)
        start += len(part.vertices)
        chain = [names.index(name) for name in part.joints]
        heights = [rest[name][1] for name in part.joints]
        at = (
            np.interp(part.vertices[:, 1], heights, range(len(chain)))
            if chain[1:]
            else np.zeros(len(part.vertices))
        )
        below = np.minimum(at.astype(int), max(len(chain) - 2, 0))
        above = np.minimum(below + 1, len(chain) - 1)
        joints.append(np.array(chain)[np.stack([below, above], -1)])
        shares.append(np.round(255 * (1 - (at - below))))
        a, b = (np.array(rest[name], float) for name in part.anchor)
        bone = b - a
        t = (part.vertices - a) @ bone / max(bone @ bone, 1e-9)
        places.append(np.round(255 * np.clip(t, 0, 1)))
        anchors.append(
            np.tile([names.index(name) for name in part.anchor], (len(part.vertices), 1))
        )
    accent = sum(len(part.triangles) for part in body if not part.accent)
    faces = np.concatenate(triangles)
    print(f"{len(faces)} triangles, {start} vertices, {accent} of the shell")
    content = {
        "names": names,
        "parents": HUMANML3D.parents,
        "rest": [rest[name] for name in names],
        "shell": accent,
        "step": STEP,
        "vertices": _base64(np.round(np.concatenate(vertices) / STEP), "<i2"),
        "triangles": _base64(faces, "<u2"),
        "joints": _base64(np.concatenate(joints), "u1"),
        "shares": _base64(np.concatenate(shares), "u1"),
        "anchors": _base64(np.concatenate(anchors), "u1"),
        "places": _base64(np.concatenate(places), "u1"),
    }
    lines = ",\n".join(f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items())
    ASSET.write_text("{\n" + lines + "\n}\n", encoding="utf-8")


def _mirrored(place: tuple[float, float, float]) -> tuple[float, float, float]:
    return -place[0], place[1], place[2]


def _base64(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


if __name__ == "__main__":
    main()
