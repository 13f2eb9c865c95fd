"""Robot descriptions: links, hinges and limits of MuJoCo's XML and of URDF.

    link in its parent    T(offset) R(rotation), then the turn about the hinge's axis

Links that are fixed to others, and those of sliding joints, stay where they are. A body with
several hinges becomes as many links. Of shapes only those of the feet matter: their lowest points
stand on the floor. Meshes of feet are read if they are binary STL or OBJ.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.kinematics.rotations import matrix_from_euler, matrix_from_quaternion

# Sizes beyond which a file is no description of a robot.
_MOST_BYTES, _MOST_LINKS, _DEEPEST = 16 * 2**20, 500, 100

# Words in the names of hinges for the parts of a body.
PARTS = {
    "hip": ("hip", "thigh"),
    "knee": ("knee", "shin", "calf"),
    "ankle": ("ankle", "foot"),
    "shoulder": ("shoulder", "sho"),
    "elbow": ("elbow", "el", "forearm"),
    "wrist": ("wrist", "hand"),
    "waist": ("waist", "torso", "spine", "back", "abdomen", "chest", "trunk"),
}

SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}  # Words for sides.

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part that turns about one hinge, or is fixed to its parent."""

    parent: int  # Its parent's number; -1 for the root.
    offset: Float[np.ndarray, " 3"]  # Its origin in its parent, meters.
    rotation: Float[np.ndarray, "3 3"]  # Its axes in its parent while the hinge is at zero.
    hinge: str = ""  # Name of its hinge; empty where it is fixed.
    # Axis of the hinge in the link, a unit vector.
    axis: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))
    # A point of the axis in the link.
    anchor: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))
    limits: tuple[float, float] = (-np.pi, np.pi)  # Least and greatest angle, radians.
    # Each returns the corners of a shape, of which meshes are read only then.
    shapes: tuple[Callable[[], np.ndarray], ...] = ()
    # Its center of mass.
    center: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def points(self) -> Float[np.ndarray, "points 3"]:
        """Corners of its shapes.

        Raises:
            InputError: A mesh is damaged.
        """
        try:
            return np.concatenate([np.zeros((0, 3)), *(shape() for shape in self.shapes)])
        except (ValueError, KeyError, IndexError) as error:
            raise InputError(f"a shape of the link after {self.hinge!r}: {error}") from error


@dataclass(frozen=True, eq=False)
class Robot:
    """A humanoid robot, its root first, parents before children.

    Raises:
        DataError: It lacks hips, knees, ankles, shoulders or elbows with known names.
    """

    name: str  # Its name.
    links: tuple[Link, ...]  # Its links.
    # Links of `left_hip`, `waist` and so on, from the root outward.
    parts: Mapping[str, tuple[int, ...]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        parts: dict[str, list[int]] = {}
        for number, link in enumerate(self.links):
            words = [word.lower() for word in _WORD.findall(link.hinge)]
            side = next((SIDES[word] for word in words if word in SIDES), "")
            for part, synonyms in PARTS.items():
                if set(words) & set(synonyms):
                    parts.setdefault(f"{side}_{part}" if side else part, []).append(number)
                    break
        needed = [f"{s}_{p}" for s in ("left", "right") for p in tuple(PARTS)[:5]]
        missing = [name for name in needed if name not in parts]
        if missing:
            raise DataError(
                f"{self.name}: no hinge is named as {', '.join(missing)}; expected names such as "
                f"left_knee_joint. Hinges found: {', '.join(self.hinges[:40]) or 'none'}"
            )
        object.__setattr__(self, "parts", {name: tuple(numbers) for name, numbers in parts.items()})

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the links with hinges, in the order of the file."""
        return tuple(number for number, link in enumerate(self.links) if link.hinge)

    @property
    def hinges(self) -> tuple[str, ...]:
        """Names of the hinges, in the order of the file."""
        return tuple(self.links[number].hinge for number in self.moving)

    @property
    def limits(self) -> Float[np.ndarray, "hinges 2"]:
        """Least and greatest angle of each hinge, radians."""
        return np.array([self.links[number].limits for number in self.moving])

    def line(self, link: int) -> tuple[int, ...]:
        """Returns a link and those above it, upward."""
        above = []
        while link >= 0:
            above.append(link)
            link = self.links[link].parent
        return tuple(above)


def read_robot(path: str | Path) -> Robot:
    """Reads a robot from MuJoCo's XML or URDF.

    Raises:
        DataError: It is no humanoid whose hinges have known names.
        FileFormatError: The file is damaged, or of another kind.
        InputError: There is no such file.
    """
    source = Path(path)
    root = _parsed(source)
    try:
        if root.tag == "mujoco":
            links = list(_Mujoco(root, source).links())
        elif root.tag == "robot":
            links = list(_urdf(root, source))
        else:
            raise FileFormatError(source, f"<{root.tag}>, expected <mujoco> or URDF's <robot>")
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise FileFormatError(source, f"a value is missing or no number ({error})") from error
    if not 0 < len(links) <= _MOST_LINKS:
        raise FileFormatError(source, f"{len(links)} links, expected 1 to {_MOST_LINKS}")
    return Robot(root.get("model") or root.get("name") or source.stem, tuple(links))


def _parsed(source: Path) -> ET.Element:
    if not source.is_file():
        raise InputError(f"there is no file {source}")
    if source.stat().st_size > _MOST_BYTES:
        raise FileFormatError(source, f"larger than {_MOST_BYTES:,} bytes, expected a description")
    try:
        return ET.fromstring(source.read_bytes())
    except (ET.ParseError, RecursionError, ValueError, LookupError) as error:
        raise FileFormatError(
            source, f"no XML ({error}); xacro files have to be expanded"
        ) from error


def _numbers(text: str | None, usual: str) -> Float[np.ndarray, " n"]:
    values = np.array((text or usual).split(), float)
    if not np.isfinite(values).all() or len(values) < len(usual.split()):
        raise ValueError(f"{text!r}, expected {len(usual.split())} numbers")
    return values


def _unit(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    length = np.linalg.norm(values)
    if not length > 1e-9:
        raise ValueError("an axis or rotation of length zero")
    return values / length


class _Mujoco:
    """MuJoCo's bodies, with the defaults of their classes."""

    def __init__(self, root: ET.Element, source: Path) -> None:
        self.source = source
        self.sections: dict[str, list[ET.Element]] = {}
        self._collect(root, source, 0)
        compiler = [c.attrib for c in self.sections.get("compiler", [])]
        options = {key: value for attributes in compiler for key, value in attributes.items()}
        self.turn = np.pi / 180 if options.get("angle", "degree") == "degree" else 1.0  # radians
        self.sequence = options.get("eulerseq", "xyz")
        self.meshes = source.parent / options.get("meshdir", options.get("assetdir", ""))
        self.files = {
            mesh.get("name") or Path(mesh.get("file", "")).stem: mesh
            for asset in self.sections.get("asset", [])
            for mesh in asset.iter("mesh")
        }
        self.defaults: dict[tuple[str, str], dict[str, str]] = {}
        for default in self.sections.get("default", []):
            self._inherit(default, {})
        self.count = 0

    def _collect(self, root: ET.Element, source: Path, depth: int) -> None:
        for child in root:
            if child.tag == "include" and depth < 5:
                self._collect(_parsed(source.parent / child.attrib["file"]), source, depth + 1)
            else:
                self.sections.setdefault(child.tag, []).append(child)

    def _inherit(self, default: ET.Element, above: dict[str, dict[str, str]]) -> None:
        name, inherited = default.get("class", "main"), {tag: dict(v) for tag, v in above.items()}
        for child in default:
            if child.tag != "default":
                inherited.setdefault(child.tag, {}).update(child.attrib)
        self.defaults |= {(name, tag): values for tag, values in inherited.items()}
        for child in default.findall("default"):
            self._inherit(child, inherited)

    def _full(self, element: ET.Element, kind: str) -> dict[str, str]:
        usual = self.defaults.get((element.get("class", kind), element.tag), {})
        return {**usual, **element.attrib}

    def links(self) -> Iterator[Link]:
        """Yields the links of the first body that moves freely, or else of the first body."""
        bodies = [b for world in self.sections.get("worldbody", []) for b in world.findall("body")]
        marks = ("freejoint", "joint[@type='free']")
        free = [b for b in bodies if any(b.find(mark) is not None for mark in marks)]
        if not bodies:
            raise FileFormatError(self.source, "no body in <worldbody>")
        yield from self._body((free or bodies)[0], -1, "main", 0)

    def _body(self, body: ET.Element, parent: int, kind: str, depth: int) -> Iterator[Link]:
        if depth > _DEEPEST:
            raise FileFormatError(self.source, f"bodies in each other {depth} deep")
        kind = body.get("childclass", kind)
        offset, rotation = _numbers(body.get("pos"), "0 0 0"), self._rotation(dict(body.attrib))
        if parent < 0:
            offset, rotation = np.zeros(3), np.eye(3)
        geoms = [partial(self._points, self._full(geom, kind)) for geom in body.findall("geom")]
        inertial = body.find("inertial")
        shape: dict[str, Any] = {"shapes": tuple(geoms)}
        if inertial is not None:
            shape["center"] = _numbers(inertial.get("pos"), "0 0 0")
        hinges = [self._full(joint, kind) for joint in body.findall("joint")]
        hinges = [h for h in hinges if h.get("type", "hinge") == "hinge"] if parent >= 0 else []
        for number, hinge in enumerate(hinges or [{}]):
            turns: dict[str, Any] = {}
            if hinge:
                turns = {
                    "hinge": hinge.get("name", f"hinge{self.count}"),
                    "axis": _unit(_numbers(hinge.get("axis"), "0 0 1")),
                    "anchor": _numbers(hinge.get("pos"), "0 0 0"),
                }
                if hinge.get("limited") != "false" and "range" in hinge:
                    low, high = self.turn * _numbers(hinge["range"], "0 0")
                    turns["limits"] = float(low), float(high)
            last = shape if number + 1 >= len(hinges) else {}
            yield Link(parent, offset, rotation, **turns, **last)
            parent, offset, rotation = self.count, np.zeros(3), np.eye(3)
            self.count += 1
        for child in body.findall("body"):
            yield from self._body(child, parent, kind, depth + 1)

    def _rotation(self, values: dict[str, str]) -> Float[np.ndarray, "3 3"]:
        if "euler" in values:
            turns = self.turn * _numbers(values["euler"], "0 0 0")
            result = np.eye(3)
            for axis, angle in zip(self.sequence, turns, strict=True):
                turn = matrix_from_euler(np.array([angle]), axis.upper())
                result = result @ turn if axis.islower() else turn @ result
            return result
        if "axisangle" in values:
            x, y, z, angle = _numbers(values["axisangle"], "0 0 1 0")
            half = 0.5 * self.turn * angle
            quaternion = np.array([np.cos(half), *(np.sin(half) * _unit(np.array([x, y, z])))])
            return matrix_from_quaternion(quaternion)
        return matrix_from_quaternion(_unit(_numbers(values.get("quat"), "1 0 0 0")))

    def _points(self, geom: dict[str, str]) -> Float[np.ndarray, "points 3"]:
        size = _numbers(geom.get("size"), "0")
        kind = geom.get("type", "mesh" if "mesh" in geom else "sphere")
        if kind == "mesh":
            mesh = self.files.get(geom.get("mesh", ""))
            points = np.zeros((0, 3)) if mesh is None else _mesh(self.meshes / mesh.get("file", ""))
            points = points * _numbers(None if mesh is None else mesh.get("scale"), "1 1 1")
        elif "fromto" in geom:
            ends = _numbers(geom["fromto"], "0 0 0 0 0 0").reshape(2, 3)
            return np.concatenate([end + _corners(size[0]) for end in ends])
        else:
            half = {"capsule": (size[0], size[0], size[-1] + size[0]), "box": size[:3]}
            half |= {"cylinder": (size[0], size[0], size[-1]), "ellipsoid": size[:3]}
            points = _corners(half.get(kind, size[0]))
        turned = points @ self._rotation(geom).T
        return turned + _numbers(geom.get("pos"), "0 0 0")


def _corners(half: object) -> Float[np.ndarray, "8 3"]:
    return np.array(list(product((-1, 1), repeat=3))) * np.asarray(half, float)


def _mesh(path: Path) -> Float[np.ndarray, "points 3"]:
    """Returns the corners of a mesh; none where it is not there or of another kind."""
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        return np.zeros((0, 3))
    content = path.read_bytes()
    if path.suffix.lower() == ".obj":
        rows = [line.split()[1:4] for line in content.splitlines() if line.startswith(b"v ")]
        return np.array(rows, float).reshape(-1, 3)
    count = int.from_bytes(content[80:84], "little")
    if path.suffix.lower() != ".stl" or len(content) != 84 + 50 * count:
        return np.zeros((0, 3))
    triangles = np.frombuffer(content, np.uint8, offset=84).reshape(count, 50)[:, 12:48]
    return np.ascontiguousarray(triangles).view("<f4").reshape(-1, 3).astype(float)


def _urdf(root: ET.Element, source: Path) -> Iterator[Link]:
    """Yields the links of a URDF, parents first."""
    below: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        below.setdefault(_link_of(joint, "parent"), []).append(joint)
    children = {_link_of(joint, "child") for joint in root.findall("joint")}
    links = {link.attrib["name"]: link for link in root.findall("link")}
    tops = [name for name in links if name not in children]
    if len(tops) != 1:
        raise FileFormatError(source, f"{len(tops)} links without a parent, expected one")
    queue: list[tuple[str, int, ET.Element | None]] = [(tops[0], -1, None)]
    number = 0
    while queue:
        name, parent, joint = queue.pop(0)
        turns: dict[str, Any] = {}
        offset, rotation = np.zeros(3), np.eye(3)
        if joint is not None:
            offset, rotation = _origin(joint)
        if joint is not None and joint.get("type") in ("revolute", "continuous"):
            limit = joint.find("limit")
            low, high = (-np.pi, np.pi)
            if joint.get("type") == "revolute" and limit is not None:
                low, high = float(limit.get("lower", 0)), float(limit.get("upper", 0))
            axis = joint.find("axis")
            turns = {
                "hinge": joint.attrib["name"],
                "axis": _unit(_numbers(None if axis is None else axis.get("xyz"), "1 0 0")),
                "limits": (low, high),
            }
        shapes = links[name].findall("collision") or links[name].findall("visual")
        points = tuple(partial(_urdf_points, shape, source.parent) for shape in shapes)
        inertial = links[name].find("inertial")
        center = np.zeros(3) if inertial is None else _origin(inertial)[0]
        yield Link(parent, offset, rotation, shapes=points, center=center, **turns)
        after = [(_link_of(each, "child"), number, each) for each in below.get(name, [])]
        queue = after + queue  # depth first, as MuJoCo orders hinges
        number += 1
        if number > _MOST_LINKS:
            raise FileFormatError(source, f"more than {_MOST_LINKS} links, or links in a circle")


def _link_of(joint: ET.Element, tag: str) -> str:
    child = joint.find(tag)
    if child is None:
        raise ValueError(f"<{joint.tag}> without <{tag}>")
    return child.attrib["link"]


def _origin(element: ET.Element) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    origin = element.find("origin")
    if origin is None:
        return np.zeros(3), np.eye(3)
    turned = matrix_from_euler(_numbers(origin.get("rpy"), "0 0 0")[::-1], "ZYX")
    return _numbers(origin.get("xyz"), "0 0 0"), turned


def _urdf_points(shape: ET.Element, folder: Path) -> Float[np.ndarray, "points 3"]:
    offset, rotation = _origin(shape)
    points = np.zeros((0, 3))
    for kind in shape.iterfind("geometry/*"):
        if kind.tag == "box":
            points = _corners(_numbers(kind.get("size"), "0 0 0") / 2)
        elif kind.tag == "sphere":
            points = _corners(float(kind.attrib["radius"]))
        elif kind.tag == "cylinder":
            radius, half = float(kind.attrib["radius"]), float(kind.attrib["length"]) / 2
            points = _corners((radius, radius, half))
        elif kind.tag == "mesh":
            name = re.sub(r"^(package://[^/]+/|file://)", "", kind.get("filename", ""))
            points = _mesh(folder / name) * _numbers(kind.get("scale"), "1 1 1")
    return points @ rotation.T + offset
