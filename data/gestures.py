"""Draws the gestures of gestures.toml on a recording of a person who stands.

    python data/gestures.py moves
    latentmotion teach data/starter.pack --wordings ... --compact -o moves

Hands follow targets with minimum jerk (Flash and Hogan 1985), arms by two-bone inverse kinematics;
all else is the recording. The first command writes an index of these clips, the second adds those
of the data to it, as in the index that ships.
"""

from __future__ import annotations

import itertools
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from jaxtyping import Float

from latentmotion import MotionPipeline
from latentmotion.data.clip import Caption, Source
from latentmotion.data.dataset import Dataset
from latentmotion.model.card import MOVES_FILE
from latentmotion.retrieval.teach import ShownClip, build_index

HERE = Path(__file__).parent
STANDING = "snu-wd2_idle_65-00000"
"""Recording of a person who stands, from which the rest of the body is."""

SIDES = {"right": 1.0, "left": -1.0}
"""Sides of the body, and the sign of outward along the axis to the right."""

EASE = 0.3
"""Seconds in which an oscillation begins and ends."""

Points = Float[np.ndarray, "frames 3"]


def draw(
    gesture: dict[str, Any],
    standing: Float[np.ndarray, "frames joints 3"],
    names: list[str],
    fps: float,
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns joints of a gesture, meters.

    Args:
        gesture: A row of gestures.toml.
        standing: A recording, played to and fro until it is long enough.
        names: Of its joints.
        fps: Of the recording.
    """
    frames = round(gesture["seconds"] * fps)
    repeats = -(-frames // (2 * len(standing)))
    joints = np.concatenate([standing, standing[::-1]] * repeats)[:frames].copy()
    times = np.arange(frames) / fps
    at = {name: n for n, name in enumerate(names)}
    across = joints[:, at["right_hip"]] - joints[:, at["left_hip"]]
    across[:, 1] = 0
    right = across / np.linalg.norm(across, axis=1, keepdims=True)
    up = np.broadcast_to([0.0, 1.0, 0.0], right.shape)
    axes = np.stack([right, up, np.cross(up, right)], axis=1)
    hands = {s: joints[:, at[f"{s}_wrist"]] - joints[:, at[f"{s}_shoulder"]] for s in SIDES}
    elbows = {
        s: joints[:, at[f"{s}_elbow"]]
        - (joints[:, at[f"{s}_shoulder"]] + joints[:, at[f"{s}_wrist"]]) / 2
        for s in SIDES
    }
    trunk = [
        at[name]
        for name in names
        if not any(leg in name for leg in ("hip", "knee", "ankle", "foot", "pelvis"))
    ]
    _turn(joints, trunk, at["spine1"], right, -_curve(gesture.get("lean"), times))
    _turn(joints, trunk, at["spine1"], up, _curve(gesture.get("twist"), times))
    _turn(joints, [at["head"]], at["neck"], right, -_curve(gesture.get("nod"), times))
    raised = _curve(gesture.get("shrug"), times)[:, None] * up
    for side in SIDES:
        joints[:, at[f"{side}_collar"]] += raised / 2
        joints[:, [at[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist")]] += raised[
            :, None
        ]
    for side, sign in SIDES.items():
        keys = gesture.get(side, gesture.get("both"))
        if not keys:
            continue
        shoulder = joints[:, at[f"{side}_shoulder"]]
        led = _path([[key[0], 0.0 if key[1] == "rest" else 1.0] for key in keys], times)
        targets = _targets(keys, joints, at, side, axes, times)
        for name in ("swing", f"swing_{side}", "swing_across"):
            if name in gesture:
                offset = np.array(gesture[name]["by"]) * (sign, 1, 1)
                targets += _wave(gesture[name], times)[:, None] * np.einsum(
                    "c,fcd->fd", offset, axes
                )
        resting = shoulder + hands[side]
        wrist = resting + led * (targets - resting)
        outward = np.array(
            gesture.get(f"elbow_{side}", gesture.get("elbow_both", [0.5, -0.8, -0.2]))
        )
        pole = _unit(np.einsum("c,fcd->fd", outward * (sign, 1, 1), axes))
        pole = _unit(elbows[side]) * (1 - led) + pole * led
        _reach(
            joints, [at[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist")], wrist, pole
        )
    return joints


def _targets(
    keys: list[list[Any]],
    joints: np.ndarray,
    at: dict[str, int],
    side: str,
    axes: np.ndarray,
    times: np.ndarray,
) -> Points:
    """Returns where a hand is led to; where it rests, that is the nearest target in time."""
    aimed = [key for key in keys if key[1] != "rest"]
    nearest = [
        key if key in aimed else min(aimed, key=lambda a: abs(a[0] - key[0])) for key in keys
    ]
    points = []
    for _, anchor, *offset in nearest:
        joint = at.get(anchor, at.get(f"{side}_{anchor}"))
        moved = np.array(offset) * (SIDES[side], 1, 1)
        points.append(joints[:, joint] + np.einsum("c,fcd->fd", moved, axes))
    low = np.clip(
        np.searchsorted([key[0] for key in keys], times, side="right") - 1, 0, len(keys) - 1
    )
    high = np.minimum(low + 1, len(keys) - 1)
    start, end = (np.array([key[0] for key in keys])[n] for n in (low, high))
    share = _eased((times - start) / np.maximum(end - start, 1e-6))[:, None]
    every, frames = np.stack(points), np.arange(len(times))
    return every[low, frames] * (1 - share) + every[high, frames] * share


def _eased(share: np.ndarray) -> np.ndarray:
    """Returns the way of least jerk from 0 to 1."""
    share = np.clip(share, 0, 1)
    return share**3 * (10 - 15 * share + 6 * share**2)


def _path(keys: list[list[float]], times: np.ndarray) -> Float[np.ndarray, "frames 1"]:
    """Returns numbers that go from key to key with minimum jerk."""
    values = np.full(len(times), float(keys[0][1]))
    for (start, _), (end, value) in itertools.pairwise(keys):
        values += (value - values) * _eased((times - start) / (end - start)) * (times > start)
        values[times >= end] = value
    return values[:, None]


def _curve(keys: list[list[float]] | None, times: np.ndarray) -> Float[np.ndarray, " frames"]:
    return _path(keys, times)[:, 0] if keys else np.zeros(len(times))


def _wave(swing: dict[str, Any], times: np.ndarray) -> Float[np.ndarray, " frames"]:
    begin, end = swing["between"]
    envelope = _eased((times - begin) / EASE) * _eased((end - times) / EASE)
    return envelope * np.sin(2 * np.pi * swing["hertz"] * (times - begin) + swing.get("phase", 0))


def _turn(
    joints: np.ndarray, moved: list[int], pivot: int, axis: Points, degrees: np.ndarray
) -> None:
    """Turns joints around one of them (Rodrigues)."""
    angle = np.radians(degrees)[:, None, None]
    about = joints[:, moved] - joints[:, [pivot]]
    k = axis[:, None]
    along = (about * k).sum(-1, keepdims=True) * k
    turned = (
        about * np.cos(angle) + np.cross(k, about) * np.sin(angle) + along * (1 - np.cos(angle))
    )
    joints[:, moved] = joints[:, [pivot]] + turned


def _reach(joints: np.ndarray, arm: list[int], wrist: Points, pole: Points) -> None:
    """Puts a wrist to a place, or as near as the arm is long, with the elbow towards a pole."""
    shoulder, elbow, hand = (joints[:, n] for n in arm)
    upper, fore = np.linalg.norm(elbow - shoulder, axis=1), np.linalg.norm(hand - elbow, axis=1)
    way = wrist - shoulder
    distance = np.clip(
        np.linalg.norm(way, axis=1), abs(upper - fore) + 0.05, 0.995 * (upper + fore)
    )
    way = _unit(way)
    along = (upper**2 - fore**2 + distance**2) / (2 * distance)
    aside = np.sqrt(np.maximum(upper**2 - along**2, 0))
    pole = _unit(pole - way * (way * pole).sum(1, keepdims=True))
    joints[:, arm[1]] = shoulder + way * along[:, None] + pole * aside[:, None]
    joints[:, arm[2]] = shoulder + way * distance[:, None]


def _unit(vectors: Points) -> Points:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


@dataclass(frozen=True)
class Gestures:
    """Write an index of the gestures."""

    out: tyro.conf.Positional[Path]
    """Folder of moves."""
    table: Path = HERE / "gestures.toml"
    """The gestures."""
    data: Path = HERE / "starter.pack"
    """Prepared data with the recording."""
    model: str = "starter"
    """Name or folder of the model whose encoders are used."""

    def run(self) -> None:
        """Writes it."""
        dataset, pipeline = Dataset.load(self.data), MotionPipeline.from_pretrained(self.model)
        space = dataset.representation
        clip = next(clip for clip in dataset.clips("train") if clip.id == STANDING)
        owner = next(source for source in dataset.sources if source.name == clip.source)
        standing = space.decode(dataset.features(clip)).astype(np.float64)
        names = [*space.skeleton.names]
        shown = []
        for number, gesture in enumerate(tomllib.loads(self.table.read_text("utf-8"))["gesture"]):
            joints = draw(gesture, standing, names, space.fps)
            features = space.encode(joints)
            captions = tuple(Caption(text, 0, len(features)) for text in gesture["captions"])
            name = f"gesture-{number:02d}"
            shown.append(ShownClip(name, "gestures", STANDING, features, captions))
        credit = f"Latent Motion, gestures drawn on a recording of {owner.credit}"
        source = Source("gestures", owner.license, credit)
        encoders = pipeline.feature_encoder, pipeline.text_encoder
        index = build_index(shown, [source], pipeline.card, *encoders).preferred()
        self.out.mkdir(parents=True, exist_ok=True)
        index.write(self.out / MOVES_FILE)
        print(f"{len(index.clips)} gestures, {len(index.captions)} sentences in {self.out}")


if __name__ == "__main__":
    tyro.cli(Gestures).run()
