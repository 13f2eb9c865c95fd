"""Draws the movements of gestures.toml on recordings of a person who stands or walks.

    python data/gestures.py src/latentmotion/models/starter   # the index there, its drawn part anew
    python data/gestures.py moves                              # an index of drawn movements alone
    python data/gestures.py moves --prepared drawn_data        # and data to train a decoder on

Hands, feet and pelvis follow targets along monotone cubic curves (Fritsch and Carlson 1980), arms
and legs by two-bone inverse kinematics; all else is the recording. Latents are those whose decoded
motion is nearest to the drawn one: the encoder's are off by 38 mm at the hands, as much as a stroke
of a brush. What the model's index has is taken from there: a clip's name is a hash of its row.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from jaxtyping import Float, Int
from torch import Tensor, nn

from latentmotion import MotionPipeline
from latentmotion.data.clip import Caption, Source, Split
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import StoredClip, StoredMotion, stored_normalizer, write_dataset
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.backend import FeatureEncoder
from latentmotion.language.claims import NO_CORRECTIONS
from latentmotion.language.reading import asked_exactly
from latentmotion.language.words import words_of
from latentmotion.model.card import MOVES_FILE, find_model
from latentmotion.networks.checkpoint import load_model
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.retrieval.doubts import SURE
from latentmotion.retrieval.index import (
    ALL_DIRECTIONS,
    DRAWN,
    EMBEDDING_LEVELS,
    MOST_LEVELS,
    NO_CLASSIFIER,
    ClipIndex,
    SentenceClassifier,
    outside_kinds,
    quantized,
    read_index,
)
from latentmotion.retrieval.teach import ShownClip, build_index
from latentmotion.retrieval.wordings import (
    along_discriminants,
    distinct,
    embedded,
    read_wordings,
    with_wordings,
)

HERE = Path(__file__).parent

# Wordings of captions that training uses.
WORDINGS = HERE.parent / "src/latentmotion/training/captioning/wordings.tsv.xz"

# Recordings on which movements are drawn.
RECORDINGS = {
    "stand": "snu-wd2_idle_65-00000",
    "walk": "cmu-69_01-00000",
    "stroll": "snu-wd2_WalkForwardSlow01-00000",
}

SOURCE = "gestures"  # Name of the owner of drawn clips in an index.

# Sides of the body, and the sign of outward along the axis to the right.
SIDES = {"right": 1.0, "left": -1.0}

EASE = 0.3  # Seconds in which an oscillation begins and ends.

# Meters by which a shoulder rises with a hand from hanging to 0.4 m above the shoulder.
SHOULDER_RISE = 0.1

# Height in meters of an ankle over its place on the floor from which its foot follows the shank.
LIFTED = 0.2

# Where an elbow and a knee point to unless a movement says otherwise: outward, up, forward.
ELBOW, KNEE = (0.5, -0.8, -0.2), (0.12, 0.0, 1.0)

# Meters from its shoulder up to which a hand goes round it, in front, rather than through it.
ROUND = 0.2

# Rank, epochs, sentences of a step, largest learning rate and scale of the embeddings, of unit
# length, of classifiers: of 600 prompts rank 96 has 80.5 % right, 192 83.1 %, 256 82.5 %.
RANK, EPOCHS, BATCH, RATE, SHARPNESS = 192, 40, 256, 2e-3, 10.0

# Of the classifier of what no body can do: the share of sentences that ask for it, and steps.
OUTSIDE_SHARE, OUTSIDE_STEPS = 0.3, 3000

STEPS = 60  # Steps of the descent to the latents of a movement.

# Least distance of hip and ankle, shoulder and wrist, as a share of the limb's length.
SHARPEST = 0.3

Points = Float[np.ndarray, "frames 3"]


@dataclass
class DrawnBody:
    """A body over time whose joints are moved."""

    # Joints, meters; in the first frame the pelvis is above the origin and faces along z.
    joints: Float[np.ndarray, "frames joints 3"]
    at: dict[str, int]  # Numbers of the joints by name.
    heading: Float[np.ndarray, "frames 3 3"]  # Right, up and forward of the recording.
    axes: Float[np.ndarray, "frames 3 3"]  # The same of the pelvis as it is turned.

    def limb(self, side: str, parts: str) -> list[int]:
        """Returns the numbers of joints of one side."""
        return [self.at[f"{side}_{part}"] for part in parts.split()]

    def offset(
        self, by: Sequence[float], sign: float = 1.0, axes: np.ndarray | None = None
    ) -> Points:
        """Returns meters outward, up and forward as a vector for each frame."""
        return np.einsum(
            "c,fcd->fd", np.array(by) * (sign, 1, 1), self.axes if axes is None else axes
        )


def draw(
    gesture: dict[str, Any],
    recording: Float[np.ndarray, "frames joints 3"],
    names: list[str],
    fps: float,
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns joints of a movement, meters.

    Args:
        gesture: A row of gestures.toml.
        recording: Played to and fro until it is long enough if the person stands.
        names: Of its joints.
        fps: Of the recording.
    """
    frames = round(gesture["seconds"] * fps) + 1  # velocities lose one
    times = np.arange(frames) / fps
    body = _body(gesture, recording, names, frames)
    start, joints, at = body.joints.copy(), body.joints, body.at
    swings = gesture.get("swing", [])

    def curve(name: str, size: int = 1) -> Float[np.ndarray, "frames size"]:
        keys = gesture.get(name, [[0.0] * (size + 1)])
        points = np.repeat(np.array([key[1:] for key in keys])[:, None], frames, axis=1)
        values = _along([key[0] for key in keys], points, times)
        for swing in swings:
            if swing["of"] == name:
                values = values + np.outer(_wave(swing, times), swing["by"])
        return values

    legs = [n for name, n in at.items() if any(p in name for p in ("knee", "ankle", "foot"))]
    upper = [n for n in range(len(names)) if n not in legs]
    for axis, sign, angle in zip((0, 2, 1), (-1, 1, 1), curve("body", 3).T, strict=True):
        _turn(joints, upper, at["pelvis"], body.axes[:, axis], sign * angle)
        _turn(body.axes, [0, 1, 2], None, body.axes[:, axis].copy(), sign * angle)
    joints[:, upper] += body.offset((1, 1, 1), axes=curve("pelvis", 3)[:, :, None] * body.heading)[
        :, None
    ]
    trunk = [n for n in upper if not any(p in names[n] for p in ("hip", "pelvis"))]
    for part in ("spine1", "spine2", "spine3"):
        moved = [n for n in trunk if not names[n].startswith("spine") or names[n] >= part]
        for name, axis, sign in (("lean", 0, -1), ("twist", 1, 1), ("bend", 2, 1)):
            _turn(joints, moved, at[part], body.axes[:, axis], sign * curve(name)[:, 0] / 3)
    _turn(joints, [at["head"]], at["neck"], body.axes[:, 0], -curve("nod")[:, 0])
    _turn(joints, [at["head"]], at["neck"], body.axes[:, 2], curve("tilt")[:, 0])
    raised = curve("shrug") * body.axes[:, 1]
    for side in SIDES:
        collar, *arm = body.limb(side, "collar shoulder elbow wrist")
        joints[:, collar] += raised / 2
        joints[:, arm] += raised[:, None]
    for side in SIDES:
        _arm(body, gesture, start, side, times)
        _step(body, gesture, start, side, times)
    return joints


def _body(
    gesture: dict[str, Any], recording: np.ndarray, names: list[str], frames: int
) -> DrawnBody:
    """Returns the recording from the origin, at a gesture's speed and as long as it is."""
    at = {name: n for n, name in enumerate(names)}
    speed = gesture.get("speed", 1.0)
    if gesture.get("on", "stand") == "stand":
        repeats = -(-round(frames * speed) // (2 * len(recording))) + 1
        recording = np.concatenate([recording, recording[::-1]] * repeats)
    moments = np.minimum(np.arange(frames) * speed, len(recording) - 1.001)
    low, part = moments.astype(int), (moments % 1)[:, None, None]
    joints = recording[low] * (1 - part) + recording[low + 1] * part
    across = joints[:, at["right_hip"]] - joints[:, at["left_hip"]]
    across[:, 1] = 0
    width = np.hanning(17)[:, None] / np.hanning(17).sum()
    padded = np.pad(_unit(across), ((8, 8), (0, 0)), "edge")
    right = _unit(
        np.stack([np.convolve(padded[:, d], width[:, 0], "valid") for d in range(3)], axis=1)
    )
    x, _, z = right[0]  # turned so that the right of the first frame is -x
    turn = np.array([[-x, 0, z], [0, 1, 0], [-z, 0, -x]])
    joints = (joints - joints[0, at["pelvis"]] * (1, 0, 1)) @ turn
    right = right @ turn
    up = np.broadcast_to([0.0, 1.0, 0.0], right.shape)
    axes = np.stack([right, up, np.cross(up, right)], axis=1)
    return DrawnBody(joints, at, axes.copy(), axes.copy())


def _places(keys: list[list[Any]]) -> list[list[Any]]:
    """Returns keys of places, each with the anchor that it is measured from."""
    return [key if isinstance(key[1], str) else [key[0], "floor", *key[1:]] for key in keys]


def _led(
    body: DrawnBody, keys: list[list[Any]], side: str, rest: Points, times: np.ndarray
) -> tuple[Points, Float[np.ndarray, "frames 1"]]:
    """Returns where a hand or a foot is led to, and how much it is led rather than at rest."""
    points = []
    for _, anchor, *by in keys:
        offset = by or (0.0, 0.0, 0.0)
        if anchor == "rest":
            points.append(rest + body.offset(offset, SIDES[side], body.heading))
        elif anchor == "floor":
            points.append(body.offset(offset, SIDES[side], body.heading[:1].repeat(len(rest), 0)))
        else:
            joint = body.at.get(anchor, body.at.get(f"{side}_{anchor}"))
            assert joint is not None, anchor
            points.append(body.joints[:, joint] + body.offset(offset, SIDES[side]))
    moments = [key[0] for key in keys]
    led = np.array([0.0 if key[1:] == ["rest"] else 1.0 for key in keys])
    shares = np.repeat(led[:, None, None], len(times), axis=1)
    return _along(moments, np.stack(points), times), _along(moments, shares, times)


def _arm(
    body: DrawnBody, gesture: dict[str, Any], start: np.ndarray, side: str, times: np.ndarray
) -> None:
    """Puts a hand to its target, or where it hangs, the shoulder and the elbow accordingly."""
    joints, sign, swings = body.joints, SIDES[side], gesture.get("swing", [])
    arm = body.limb(side, "shoulder elbow wrist")
    turned = np.einsum("fca,fcb->fab", body.heading, body.axes)
    hang = np.einsum("fd,fdb->fb", start[:, arm[2]] - start[:, arm[0]], turned)
    bent = start[:, arm[1]] - (start[:, arm[0]] + start[:, arm[2]]) / 2
    bent = np.einsum("fd,fdb->fb", bent, turned)
    keys = _places(gesture.get(side, gesture.get("both", [[0.0, "rest"]])))
    if all(key[1:] == ["rest"] for key in keys):
        _reach(joints, arm, joints[:, arm[0]] + hang, _unit(bent))
        return
    wrist, led = _led(body, keys, side, joints[:, arm[0]] + hang, times)
    higher = ((wrist - joints[:, arm[0]]) * body.axes[:, 1]).sum(axis=1)
    higher = led[:, 0] * np.clip((higher + 0.5) / 0.9, 0, 1)
    rise = (SHOULDER_RISE * higher[:, None] * body.axes[:, 1])[:, None]
    joints[:, [body.at[f"{side}_collar"], *arm]] += rise * [[0.5], [1.0], [1.0], [1.0]]
    wrist, _ = _led(body, keys, side, joints[:, arm[0]] + hang, times)
    wrist += led * _swung(body, swings, (side, "both"), sign, times)
    near = np.linalg.norm(wrist - joints[:, arm[0]], axis=1, keepdims=True)
    wrist += np.maximum(ROUND - near, 0) * led * body.axes[:, 2]
    pole = _pole(gesture, "elbow", side, "both", ELBOW)
    pole = _unit(bent) * (1 - led) + _unit(body.offset(pole, sign)) * led
    _reach(joints, arm, wrist, pole)


def _step(
    body: DrawnBody, gesture: dict[str, Any], start: np.ndarray, side: str, times: np.ndarray
) -> None:
    """Puts a leg's ankle to its target, the knee and the foot accordingly."""
    sign, swings = SIDES[side], gesture.get("swing", [])
    hip, knee, ankle, toe = body.limb(side, "hip knee ankle foot")
    floor = float(start[:, ankle, 1].min())
    rest = start[:, ankle].copy()
    rest[:, 1] = floor + gesture.get("lift", 1.0) * (rest[:, 1] - floor)
    beside = ((rest - start[:, 0]) * body.heading[:, 0]).sum(1, keepdims=True) * body.heading[:, 0]
    rest += (gesture.get("width", 1.0) - 1) * beside
    keys = _places(gesture.get(f"foot_{side}", gesture.get("feet", [[0.0, "rest"]])))
    place, _ = _led(body, keys, side, rest, times)
    place = place + _swung(body, swings, (f"foot_{side}", "feet"), sign, times)
    on_floor = _along(
        [key[0] for key in keys],
        np.repeat([[[floor * (key[1] == "floor")]] for key in keys], len(times), axis=1),
        times,
    )
    place[:, 1:2] += on_floor
    pole = _unit(body.offset(_pole(gesture, "knee", side, "feet", KNEE), sign))
    foot = start[:, toe] - start[:, ankle]
    shank = _unit(start[:, ankle] - start[:, knee])
    body.joints[:, [knee, ankle, toe]] += (body.joints[:, hip] - start[:, hip])[:, None]
    _reach(body.joints, [hip, knee, ankle], place, pole)
    toes = _pole(gesture, "toes", side, "feet", None)
    if toes is not None:
        points = np.stack([body.offset(key[1:], sign, body.heading) for key in toes])
        aimed = _along([key[0] for key in toes], points, times)
    else:
        now = _unit(body.joints[:, ankle] - body.joints[:, knee])
        share = np.clip((body.joints[:, ankle, 1:2] - rest[:, 1:2]) / LIFTED, 0, 1)
        # The foot turned by the smallest turn from the shank as it was to the shank now.
        axis, cosine = np.cross(shank, now), (shank * now).sum(1, keepdims=True)
        along = axis * (axis * foot).sum(1, keepdims=True) / np.maximum(1 + cosine, 1e-6)
        carried = foot * cosine + np.cross(axis, foot) + along
        aimed = foot * (1 - share) + carried * share
    length = np.linalg.norm(foot, axis=1, keepdims=True)
    body.joints[:, toe] = body.joints[:, ankle] + _unit(aimed) * length


def _pole(gesture: dict[str, Any], name: str, side: str, both: str, usual: Any) -> Any:
    return gesture.get(f"{name}_{side}", gesture.get(f"{name}_{both}", usual))


def _along(
    moments: Sequence[float], points: Float[np.ndarray, "keys frames size"], times: np.ndarray
) -> Float[np.ndarray, "frames size"]:
    """Returns points from key to key along monotone cubics, which rest where two keys agree."""
    at = np.array(moments, float)
    if len(at) == 1:
        return points[0]
    step = np.diff(at)[:, None, None]
    slope = np.diff(points, axis=0) / step
    before, after = slope[:-1], slope[1:]
    same = before * after > 1e-12
    both = np.where(same, before + after, 1.0)
    tangent = np.zeros_like(points)
    tangent[1:-1] = np.where(same, 2 * before * after / both, 0.0)
    low = np.clip(np.searchsorted(at, times, side="right") - 1, 0, len(at) - 2)
    frames = np.arange(len(times))
    width = step[low, 0]
    s = np.clip((times - at[low]) / width[:, 0], 0, 1)[:, None]
    return (
        points[low, frames] * (1 + 2 * s) * (1 - s) ** 2
        + points[low + 1, frames] * (3 - 2 * s) * s**2
        + tangent[low, frames] * width * s * (1 - s) ** 2
        - tangent[low + 1, frames] * width * s**2 * (1 - s)
    )


def _swung(
    body: DrawnBody,
    swings: list[dict[str, Any]],
    of: tuple[str, ...],
    sign: float,
    times: np.ndarray,
) -> Points:
    """Returns the oscillations of a hand or a foot."""
    moved = np.zeros((len(times), 3))
    for swing in swings:
        if swing["of"] in of:
            moved += _wave(swing, times)[:, None] * body.offset(swing["by"], sign)
    return moved


def _wave(swing: dict[str, Any], times: np.ndarray) -> Float[np.ndarray, " frames"]:
    begin, end = swing["between"]
    rise, fall = np.clip((times - begin) / EASE, 0, 1), np.clip((end - times) / EASE, 0, 1)
    envelope = rise**2 * (3 - 2 * rise) * fall**2 * (3 - 2 * fall)
    return envelope * np.sin(2 * np.pi * swing["hertz"] * (times - begin) + swing.get("phase", 0))


def _turn(
    joints: np.ndarray, moved: list[int], pivot: int | None, axis: Points, degrees: np.ndarray
) -> None:
    """Turns joints around one of them, or directions (Rodrigues)."""
    angle = np.radians(degrees)[:, None, None]
    center = 0.0 if pivot is None else joints[:, [pivot]].copy()
    about, k = joints[:, moved] - center, axis[:, None]
    along = (about * k).sum(-1, keepdims=True) * k
    joints[:, moved] = (
        center
        + about * np.cos(angle)
        + np.cross(k, about) * np.sin(angle)
        + along * (1 - np.cos(angle))
    )


def _reach(joints: np.ndarray, limb: list[int], end: Points, pole: Points) -> None:
    """Puts a limb's end to a place, or as near as it is long, its middle joint towards a pole."""
    root, middle, tip = (joints[:, n] for n in limb)
    upper, lower = np.linalg.norm(middle - root, axis=1), np.linalg.norm(tip - middle, axis=1)
    way = end - root
    longest = upper + lower
    distance = np.clip(np.linalg.norm(way, axis=1), SHARPEST * longest, 0.995 * longest)
    way = _unit(way)
    along = (upper**2 - lower**2 + distance**2) / (2 * distance)
    aside = np.sqrt(np.maximum(upper**2 - along**2, 0))
    pole = _unit(pole - way * (way * pole).sum(1, keepdims=True))
    joints[:, limb[1]] = root + way * along[:, None] + pole * aside[:, None]
    joints[:, limb[2]] = root + way * distance[:, None]


def _unit(vectors: Points) -> Points:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


@dataclass(frozen=True)
class NearestLatents:
    """Finds latents by descent through the decoder, from where the encoder puts them."""

    encoder: FeatureEncoder  # Where the descent begins.
    vae: MotionVAE  # Decodes.
    # Of squared errors of normalized features: places and speeds of joints count in meters.
    weight: Float[Tensor, " features"]

    @classmethod
    def of(cls, model: Path, encoder: FeatureEncoder) -> NearestLatents:
        """Opens the VAE of a model."""
        vae = load_model(model).vae.eval().requires_grad_(False)
        deviation = torch.as_tensor(encoder.features.std)
        weight = torch.full_like(deviation, 0.02 / len(deviation))
        weight[:4] += 0.2 / 4
        weight[4:67] += 1e3 / 63 * deviation[4:67] ** 2
        weight[67:193] += 20 / 126 * deviation[67:193] ** 2
        weight[193:259] += 2e3 / 66 * deviation[193:259] ** 2
        return cls(encoder, vae, weight)

    def __call__(self, features: Float[np.ndarray, "frames features"]) -> np.ndarray:
        """Returns the latents of one motion, (tokens, width)."""
        scales = self.encoder
        target = torch.as_tensor(scales.features.normalize(features.astype(np.float32)))
        mean, deviation = map(torch.as_tensor, (scales.latents.mean, scales.latents.std))
        first = torch.as_tensor(scales(features))
        z, mask = first.clone().requires_grad_(), torch.ones(1, len(target), dtype=torch.bool)
        optimizer = torch.optim.Adam([z], lr=0.05)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS, 0.0025)
        for _ in range(STEPS):
            optimizer.zero_grad()
            decoded = self.vae.decode((z * deviation + mean)[None], mask)[0]
            error = ((decoded - target) ** 2 * self.weight).sum(dim=1).mean()
            (error + 0.01 * ((z - first) ** 2).mean()).backward()
            optimizer.step()
            schedule.step()
        return z.detach().numpy()


def read_rows(table: Path) -> list[dict[str, Any]]:
    """Returns the rows of a table; one that mirrors another has all that the other has."""
    rows = tomllib.loads(table.read_text("utf-8"))["gesture"]
    by_name = {row["captions"][0]: row for row in rows}
    return [{**by_name.get(row.get("mirrors"), {}), **row} for row in rows]


def name_of(gesture: dict[str, Any]) -> str:
    """Returns the name of a row's clip, which other captions leave as it is."""
    drawn = json.dumps({key: value for key, value in gesture.items() if key != "captions"})
    return f"gesture-{hashlib.sha256(drawn.encode()).hexdigest()[:8]}"


def recorded(index: ClipIndex) -> ClipIndex:
    """Returns an index without its drawn clips, which come first."""
    drawn = [clip for clip in index.clips if clip.source == SOURCE]
    rows, texts = sum(clip.tokens for clip in drawn), [set[str]() for _ in drawn]
    captions = sum(caption.support == DRAWN for caption in index.captions)
    for caption in index.captions[:captions]:
        texts[caption.clip].update(words_of(caption.text))
    moved = (replace(clip, start=clip.start - rows) for clip in index.clips[len(drawn) :])
    others = (replace(c, clip=c.clip - len(drawn)) for c in index.captions[captions:])
    remaining = index.wordings >= captions
    return replace(
        index,
        sources=tuple(source for source in index.sources if source.name != SOURCE),
        clips=tuple(moved),
        captions=tuple(others),
        latents=index.latents[rows:],
        wordings=index.wordings[remaining] - captions,
        embeddings=index.embeddings[captions:][
            np.append(np.ones(len(index.captions) - captions, bool), remaining)
        ],
        words=dict(Counter(index.words) - Counter(word for text in texts for word in text)),
        classifier=NO_CLASSIFIER,
        outside=NO_CLASSIFIER,
    )


def fitted_classifier(
    vectors: Float[np.ndarray, "sentences width"],
    labels: Int[np.ndarray, " sentences"],
    rank: int,
    steps: int,
    weights: Float[np.ndarray, " sentences"] | None = None,
) -> SentenceClassifier:
    """Returns a softmax regression that tells the labels of sentences.

    Args:
        vectors: Embeddings of unit length.
        labels: Numbers of what the sentences ask for.
        rank: Of the regression.
        steps: Steps of the fit.
        weights: How often each is drawn; all alike by default.
    """
    classes, numbers = np.unique(labels, return_inverse=True)
    sentences, targets = map(torch.from_numpy, (vectors, numbers))
    chances = torch.ones(len(labels)) if weights is None else torch.from_numpy(weights)
    torch.manual_seed(0)
    layers = nn.Dropout(0.1), nn.Linear(vectors.shape[1], rank), nn.Linear(rank, len(classes))
    network = nn.Sequential(*layers)
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps)
    draws = torch.multinomial(chances, steps * BATCH, replacement=True).reshape(steps, BATCH)
    for rows in draws:
        values = network(sentences[rows] * SHARPNESS)
        loss = nn.functional.cross_entropy(values, targets[rows], label_smoothing=0.1)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    _, inward, outward = ({n: p.detach().numpy() for n, p in x.named_parameters()} for x in layers)
    bias = inward["bias"] @ outward["weight"].T + outward["bias"]
    matrices = SHARPNESS * inward["weight"].T, outward["weight"].T
    return SentenceClassifier(*matrices, bias, classes.astype(np.int32))


def movement_classifier(
    index: ClipIndex, wordings: Mapping[str, Sequence[str]], text_encoder: TextEncoder
) -> SentenceClassifier:
    """Returns a classifier of the drawn movement that a sentence names, fitted to all.

    Args:
        index: Drawn movements; the first caption of each is its name.
        wordings: Of their names.
        text_encoder: The encoder of the index.
    """
    firsts = np.array([index.captions_of[number][0] for number in range(len(index.clips))])
    number_of = {index.captions[row].text: row for row in firsts}
    said = [(caption.text, firsts[caption.clip]) for caption in index.captions]
    said += [(text, number_of[name]) for name, texts in wordings.items() for text in texts]
    vectors = embedded([text for text, _ in said], text_encoder)
    labels = np.array([row for _, row in said])
    return fitted_classifier(vectors, labels, RANK, EPOCHS * len(said) // BATCH)


def outside_classifier(
    table: Path, movements: Sequence[str], text_encoder: TextEncoder
) -> SentenceClassifier:
    """Returns a classifier of what no body can do.

    Args:
        table: A kind of `outside.toml`, or "movement", and a sentence in each line.
        movements: Further sentences that ask for a movement.
        text_encoder: The encoder of an index.
    """
    lines = lzma.decompress(table.read_bytes()).decode().splitlines()
    rows = [tuple(line.split("\t")) for line in lines]
    numbers = {"movement": -1} | {kind["name"]: n for n, kind in enumerate(outside_kinds())}
    kinds = np.array([numbers[kind] for kind, _ in rows])
    labels = np.append(kinds, np.full(len(movements), -1))
    # Of the sentences that are drawn, the table's that ask for a movement, which are like those
    # that do not, are a twentieth.
    weights = np.full(len(labels), (1 - OUTSIDE_SHARE - 0.05) / len(movements))
    weights[: len(rows)] = np.where(
        kinds < 0, 0.05 / (kinds < 0).sum(), OUTSIDE_SHARE / (kinds >= 0).sum()
    )
    vectors = embedded([*(text for _, text in rows), *movements], text_encoder)
    return fitted_classifier(vectors, labels, len(numbers), OUTSIDE_STEPS, weights)


def beside_classifier(
    index: ClipIndex, wordings: Mapping[str, Sequence[str]], text_encoder: TextEncoder
) -> dict[str, list[str]]:
    """Returns wordings that name their movement where the classifier of an index does not.

    It recognizes them, but not surely, or they name an exact turn or count, for which it is not
    asked. Those that it takes for another movement name both and are left out.
    """
    remaining: dict[str, list[str]] = {}
    for name, texts in wordings.items():
        classified = [index.classified(vector[None]) for vector in embedded(texts, text_encoder)]
        remaining[name] = [
            text
            for text, movement in zip(texts, classified, strict=True)
            if asked_exactly(text, any_length=True) != NO_CORRECTIONS
            or (movement and movement.caption.text == name and movement.probability < SURE)
        ]
    return remaining


def embedded_anew(
    index: ClipIndex, wordings: Mapping[str, Sequence[str]], text_encoder: TextEncoder
) -> ClipIndex:
    """Returns an index with captions and these wordings as an encoder embeds them now."""
    texts = [caption.text for caption in index.captions]
    codes, _ = quantized(embedded(texts, text_encoder), 1, EMBEDDING_LEVELS)
    none, every = np.zeros(0, np.int32), ALL_DIRECTIONS
    index = replace(index, wordings=none, embeddings=codes, directions=every)
    return with_wordings(index, wordings, text_encoder)


def write_prepared(
    folder: Path, dataset: Dataset, shown: Sequence[ShownClip], source: Source
) -> None:
    """Writes a prepared folder of data and movements, normalized as the data are."""
    space = dataset.representation

    def motions() -> Iterator[StoredMotion]:
        for clip in (*dataset.clips("train"), *dataset.clips("val")):
            yield stored(clip.id, clip.source, clip.origin, clip.split, dataset.features(clip))
        for clip in shown:
            yield stored(clip.id, SOURCE, clip.origin, "train", clip.features)

    def stored(
        name: str, owner: str, origin: str, split: Split, features: np.ndarray
    ) -> StoredMotion:
        return StoredMotion(
            StoredClip(name, owner, origin, split, len(features), 0, 0, (), ()), features
        )

    normalizer = stored_normalizer(dataset.normalizer, str(dataset.folder))
    write_dataset(folder, motions(), (*dataset.sources, source), space, normalizer)


@dataclass(frozen=True)
class Gestures:
    """Write an index of the movements."""

    out: tyro.conf.Positional[Path]  # Folder of moves; recordings of one that is there are kept.
    table: Path = HERE / "gestures.toml"  # The movements.
    data: Path = HERE / "starter.pack"  # Prepared data with the recordings.
    model: str = "starter"  # Name or folder of the model whose encoders are used.
    anew: bool = False  # Search all latents, as after a change to the decoder: ten minutes.
    # Embed the sentences of recordings anew, and find the directions, as after a change to the text
    # encoder or with many new wordings: two minutes.
    embed: bool = False
    # Folder for the data without its test clips, each clip as one item, and the movements: a
    # decoder that trains on it draws movements as they are drawn.
    prepared: Path | None = None
    # Wordings of the names of movements, as of `latentmotion teach`.
    wordings: Path = HERE / "phrases.tsv.xz"
    outside: Path = HERE / "outside.tsv.xz"  # Sentences that ask for what no body can do.
    # Wordings of the captions of recordings, which the index keeps from then on.
    further: tuple[Path, ...] = (WORDINGS,)

    def run(self) -> None:
        """Writes it."""
        dataset, pipeline = Dataset.load(self.data), MotionPipeline.from_pretrained(self.model)
        space, target = dataset.representation, self.out / MOVES_FILE
        clips = {clip.id: clip for clip in dataset.clips("train")}
        recordings = {
            name: space.decode(dataset.features(clips[clip])).astype(np.float64)
            for name, clip in RECORDINGS.items()
        }
        names, shown, latents = [*space.skeleton.names], [], []
        owners = {clips[clip].source for clip in RECORDINGS.values()}
        for gesture in read_rows(self.table):
            name = gesture.get("on", "stand")
            features = space.encode(draw(gesture, recordings[name], names, space.fps))
            features = space.mirror(features) if "mirrors" in gesture else features
            captions = tuple(Caption(text, 0, len(features)) for text in gesture["captions"])
            origin = RECORDINGS[name]
            shown.append(ShownClip(name_of(gesture), SOURCE, origin, features, captions))
        credits = [source.credit for source in dataset.sources if source.name in owners]
        licenses = {source.license for source in dataset.sources if source.name in owners}
        credit = f"Latent Motion, drawn on recordings of {'; '.join(credits)}"
        source = Source(SOURCE, " and ".join(sorted(licenses)), credit)
        if self.prepared:
            write_prepared(self.prepared, dataset, shown, source)
        search = NearestLatents.of(find_model(self.model), pipeline.feature_encoder)
        shipped = pipeline.clip_starts.chooser.index if pipeline.clip_starts else None
        stored = {clip.id: clip for clip in shipped.clips} if shipped and not self.anew else {}

        def encoder(features: Float[np.ndarray, "frames features"]) -> np.ndarray:
            clip = stored.get(shown[len(latents)].id)
            if clip and shipped:
                codes = shipped.latents[clip.start : clip.start + clip.tokens]
                latents.append(codes * shipped.latent_scale)
            else:
                latents.append(search(features))
            return latents[-1]

        index = build_index(shown, [source], pipeline.card, encoder, pipeline.text_encoder)
        every = np.concatenate(latents)
        scale = shipped.latent_scale if shipped else quantized(every, 0, MOST_LEVELS)[1]
        codes = np.clip(np.round(every / scale), -MOST_LEVELS, MOST_LEVELS).astype(np.int8)
        index = replace(index.preferred(DRAWN), latents=codes, latent_scale=scale)
        names = {row["captions"][0] for row in read_rows(self.table)}
        wordings = read_wordings([self.wordings])
        further = {n: w for n, w in wordings.items() if n not in names}
        drawn = {n: w for n, w in wordings.items() if n in names}
        # A regression of few movements would take every sentence for one of them.
        earlier = read_index(target) if target.is_file() else None
        if earlier and any(clip.source != SOURCE for clip in earlier.clips):
            recordings = recorded(earlier)
            texts = [caption.text for caption in (*index.captions, *recordings.captions)]
            texts += chain.from_iterable(wordings.values())
            outside = outside_classifier(self.outside, texts, pipeline.text_encoder)
            fitted = movement_classifier(index, drawn, pipeline.text_encoder)
            index = replace(index, classifier=fitted, outside=outside)
            drawn = beside_classifier(index, drawn, pipeline.text_encoder)
            if self.embed:
                for name, texts in read_wordings(self.further).items():
                    further[name] = [*further.get(name, ()), *texts]
                recordings = embedded_anew(recordings, further, pipeline.text_encoder)
            index = index.joined(recordings)
        if any(drawn.values()):
            index = with_wordings(index, drawn, pipeline.text_encoder)
        index = distinct(along_discriminants(index) if self.embed else index)
        self.out.mkdir(parents=True, exist_ok=True)
        index.write(target)
        searched = sum(clip.id not in stored for clip in shown)
        print(f"{len(shown)} movements, {searched} of them searched, in {target}")


if __name__ == "__main__":
    tyro.cli(Gestures).run()
