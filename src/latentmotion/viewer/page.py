"""Motions → one self-contained HTML page that shows them: no server, no network, no other file.

The page carries each motion as root positions (float32) and joints relative to the root (int16
steps of 0.1 mm, or more where a motion is wider than 3.2 m), in base64. `viewer.js` beside this
file is a build product of `source/`; see `source/README.md`.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import quaternion_from_matrix
from latentmotion.motion import Motion
from latentmotion.storage.files import write_file

FINEST_STEP = 1e-4  # Step of the quantized joint positions, meters.


@dataclass(frozen=True, eq=False)
class Skinned:
    """A skin that bones carry, at rest, and how they move it in each motion."""

    vertices: Float[np.ndarray, "vertices 3"]  # Positions, meters.
    normals: Float[np.ndarray, "vertices 3"]  # Outward unit normals.
    # Corners of each face, counterclockwise from outside.
    triangles: Int[np.ndarray, "triangles 3"]
    joints: Int[np.ndarray, "vertices 4"]  # The bones that carry each vertex.
    weights: Float[np.ndarray, "vertices 4"]  # Weight of each; the sum is 1.
    # For each motion, how far every bone is turned from rest, in the world.
    rotations: Sequence[Float[np.ndarray, "frames bones 3 3"]]
    # For each motion, where every bone puts the origin, meters.
    shifts: Sequence[Float[np.ndarray, "frames bones 3"]]

    def content(self) -> dict[str, Any]:
        """Returns a skin and its moves as the page's script reads them."""
        vertices, bones = self.vertices, self.rotations[0].shape[1]
        step = max(FINEST_STEP, float(np.abs(vertices).max()) / np.iinfo(np.int16).max)
        skin = {
            "step": step,
            "bones": bones,
            "positions": _base64(np.round(vertices / step).astype("<i2")),
            "normals": _base64(np.round(127 * self.normals).astype("i1")),
            "triangles": _base64(
                self.triangles.astype("<u2" if len(vertices) <= 65_535 else "<u4")
            ),
            # The smallest integers that hold all bones, since the page embeds them as base64.
            "joints": _base64(self.joints.astype("u1" if bones <= 256 else "<u2")),
            "weights": _base64(np.round(255 * self.weights).astype("u1")),
        }
        moves = []
        for rotations, shifts in zip(self.rotations, self.shifts, strict=True):
            quaternions = quaternion_from_matrix(rotations)[..., [1, 2, 3, 0]]
            turns = np.round(np.iinfo(np.int16).max * quaternions).astype("<i2")
            moves.append({"rotations": _base64(turns), "shifts": _base64(shifts.astype("<f4"))})
        return {"skin": skin, "moves": moves}


def page_html(
    motions: Sequence[Motion], figure: Literal["mannequin", "stick"] | Skinned = "mannequin"
) -> str:
    """Returns a page that shows the motions side by side.

    Args:
        motions: At least one; each stands beside the one before, in its own color.
        figure: The mannequin, a stick figure, or a skin with its moves in these motions.

    Raises:
        InputError: There is no motion.
    """
    if not motions:
        raise InputError("no motion to show; give at least one")
    content = payload(motions)
    for entry, motion in zip(content["motions"], motions, strict=True):
        entry["marks"] = marks_of(motion)
    if figure != "mannequin":
        content["figure"] = figure if isinstance(figure, str) else figure.content()
    title, notes = motions[0].caption or "Latent Motion", chain.from_iterable(map(_notes, motions))
    return filled_page(title, json_in_html(content), "\n".join(dict.fromkeys(notes)))


def filled_page(title: str, motions: str, notes: str = "") -> str:
    """Returns the page with its script, around what `json_in_html` returns of motions.

    Args:
        title: Of the page.
        motions: What `json_in_html` returns.
        notes: What was not known, or read otherwise, a line each.
    """
    fields = {"title": html.escape(title), "notes": html.escape(notes), "motions": motions}
    return _filled(_resource("template.html"), {**fields, "script": packed_script()})


def split_page(style: str, script: str) -> tuple[str, str]:
    """Returns the page without motions, with nothing inline, and its style sheet.

    A server sends both under a strict Content-Security-Policy. The script has to fill the element
    `motions` with `payload` as JSON and to load `script()` then.

    Args:
        style: Address of the style sheet.
        script: Address of the script.
    """
    parts = re.fullmatch(
        r"(.*)<meta http-equiv=.*?>\n(.*)<style>\n(.*)</style>(.*)<script>.*</script>(.*)",
        _resource("template.html"),
        re.DOTALL,
    )
    assert parts is not None
    before, head, css, body, end = parts.groups()
    link = f'<link rel="stylesheet" href="{style}">'
    page = f'{before}{head}{link}{body}<script src="{script}"></script>{end}'
    return _filled(page, {"title": "Latent Motion", "motions": "", "notes": ""}), css


def _filled(page: str, fields: Mapping[str, str]) -> str:
    return re.sub(r"\{\{(\w+)\}\}", lambda field: fields[field[1]], page)


def write_page(
    path: str | Path,
    motions: Sequence[Motion],
    figure: Literal["mannequin", "stick"] | Skinned = "mannequin",
) -> None:
    """Writes `page_html` to a file, whole or not at all."""
    write_file(path, page_html(motions, figure=figure))


def payload(motions: Sequence[Motion]) -> dict[str, Any]:
    """Returns motions as the page's script reads them; those of one skeleton share a body."""
    skeletons: dict[str, Any] = {}
    entries: list[dict[str, Any]] = []
    for name, motion in {motion.skeleton.name: motion for motion in reversed(motions)}.items():
        skeleton = motion.skeleton
        bones = motion.joints - motion.joints[:, [max(parent, 0) for parent in skeleton.parents]]
        skeletons[name] = {
            "names": skeleton.names,
            "parents": skeleton.parents,
            "directions": np.round(skeleton.offsets, 4).tolist(),
            "lengths": np.round(np.median(np.linalg.norm(bones, axis=-1), axis=0), 4).tolist(),
        }
    for motion in motions:
        root = motion.joints[:, 0]
        relative = motion.joints - root[:, None]
        step = max(FINEST_STEP, float(np.abs(relative).max()) / np.iinfo(np.int16).max)
        entries.append(
            {
                "caption": motion.caption,
                "fps": float(motion.fps),
                "skeleton": motion.skeleton.name,
                "step": step,
                "root": _base64(root.astype("<f4")),
                "relative": _base64(np.round(relative / step).astype("<i2")),
            }
        )
    return {"skeletons": skeletons, "motions": entries}


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")


def json_in_html(payload: dict[str, Any]) -> str:
    """Returns JSON in which no caption can end the script element around it."""
    text = json.dumps(payload, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def script() -> str:
    """Returns the script of the pages that show motion, as the studio serves it."""
    return _resource("viewer.js")


@lru_cache(maxsize=1)
def packed_script() -> str:
    """Returns a script that unpacks and runs `script()`: three times smaller, after its notice."""
    plain = script()
    notice = "".join(re.findall(r"\A/\*!.*?\*/", plain, re.DOTALL))
    packed = base64.b64encode(gzip.compress(plain.encode(), mtime=0)).decode("ascii")
    return f"""{notice}
(async () => {{
  const packed = Uint8Array.from(atob("{packed}"), (letter) => letter.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const textContent = await new Response(plain).text();
  document.head.append(Object.assign(document.createElement("script"), {{ textContent }}));
}})();"""


def _resource(name: str) -> str:
    return resources.files("latentmotion.viewer").joinpath(name).read_text(encoding="utf-8")


# Most marks of one kind that the page draws.
_MOST_MARKS = 500


def marks_of(motion: Motion) -> dict[str, Any]:
    """Returns goals, spans and objects of a motion for the page; absent kinds are left out.

    Metadata may come from any file: what is not of the expected form is left out, too.

    Returns:
        `goals`: joint, at (seconds) and to (meters); `path`: at and to (x and z) of the points that
        the pelvis passes; `poses`: seconds of keyframes; `spans`: prompt, start and end (seconds),
        and the part of the body if it is of one; `boxes`: what carries the body, see
        `Motion.objects`.
    """
    names = motion.skeleton.names
    points, path, spans = [], [], []
    poses: set[float] = set()
    for goal in _entries(motion, "goals"):
        with suppress(*_UNEXPECTED):
            at = _number(goal["at"], 0, motion.seconds)
            if "pose" in goal:
                poses.add(at)
            if "relative_to" in goal:
                continue
            # Of a hand it is the wrist.
            joint = goal["joint"].replace("_hand", "_wrist").replace("_fingertips", "_wrist")
            number = names.index(joint)
            x, y, z = (
                None if value is None else _number(value, -_FARTHEST, _FARTHEST)
                for value in goal["to"]
            )
            if goal["joint"] == names[0] and y is None and x is not None and z is not None:
                path.append({"at": at, "to": [x, z]})
                continue
            # A coordinate that is free is where the joint is.
            current = motion.joints[min(round(at * motion.fps), len(motion) - 1), number].tolist()
            to = [b if a is None else a for a, b in zip((x, y, z), current, strict=True)]
            points.append({"joint": joint, "at": at, "to": [round(v, 4) for v in to]})
    if path and path[0]["at"] > 0:
        path.insert(0, {"at": 0.0, "to": [round(float(v), 4) for v in motion.joints[0, 0, ::2]]})
    for span in _entries(motion, "spans"):
        with suppress(*_UNEXPECTED):
            start = _number(span["start"], 0, motion.seconds + 1)
            end = _number(span["end"], start, motion.seconds + 1)
            if isinstance(span["prompt"], str) and start < end:
                part = {"part": span["part"]} if isinstance(span.get("part"), str) else {}
                spans.append({"prompt": span["prompt"], "start": start, "end": end, **part})
    boxes = [{"name": each.name, **each.about()} for each in motion.objects]
    kinds = {"goals": points, "path": path, "poses": sorted(poses), "spans": spans, "boxes": boxes}
    return {name: marks[:_MOST_MARKS] for name, marks in kinds.items() if marks}


# What reading an entry raises that is not of the expected form.
_UNEXPECTED = (KeyError, TypeError, ValueError, AttributeError)

_FARTHEST = 1e6  # Coordinates that the page draws, meters.


def _notes(motion: Motion) -> list[str]:
    """Returns what a motion's file says of its prompt; metadata may come from any file."""
    notes = motion.metadata.get("notes")
    return [note for note in notes if isinstance(note, str)] if isinstance(notes, list) else []


def _entries(motion: Motion, name: str) -> list[Mapping[str, Any]]:
    entries = motion.metadata.get(name)
    entries = entries if isinstance(entries, list) else []
    return [entry for entry in entries if isinstance(entry, Mapping)]


def _number(value: Any, least: float, most: float) -> float:
    """Returns a number of a range.

    Raises:
        ValueError: It is none; NaN is in no range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise ValueError(value)
    return float(value)
