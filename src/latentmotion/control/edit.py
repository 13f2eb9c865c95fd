"""Edits: a span of a motion is generated again; the frames around it are kept.

The frames around the gap become latents, which are kept while those of the gap are sampled. Then
the gap's are moved until what follows is at its place and faces its direction, and the new frames
are pasted with the position and the velocity of both seams.

Body parts of one motion on another: the bones of a part, turned with the body that carries it.

A part hangs on a joint that stays where it is. Its bones are taken relative to the joints around
that one (Kabsch's rotation between both motions), and get the lengths that they have there.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup import clean
from latentmotion.cleanup.floor import lift_feet
from latentmotion.cleanup.pipeline import CleanUpWarning
from latentmotion.cleanup.smoothing import gaussian, quintic, upper_envelope
from latentmotion.control.exact import inertialized
from latentmotion.control.generator import Generator, decoders_of, latents_of, metadata_of
from latentmotion.control.goals import NO_TARGETS, TargetResidual, Targets
from latentmotion.control.reach import (
    Correction,
    DecodedMotion,
    ReachSettings,
    Sample,
    fit_latents,
    latent_width,
    reach,
)
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import InputError, named
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.inverse_kinematics import nearest_rotation
from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.model.config import STRIDE, Sampling
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn

# Latents that are kept on either side of a gap; beyond some two the decoder hardly sees them.
TOKENS = 8

# Frames in which the offsets at a seam decay.
_SEAM = 12

# Meters by which a body is lifted as a whole where feet sink: a straight leg would bend far for it.
_WHOLE = 0.04

# Frames from a seam in which such corrections come and go.
_LIFTED = 5

ON_THE_WAY = "a person walks"  # Prompt by default of the motion between two others.


@dataclass(frozen=True)
class Gap:
    """The frames of a motion that are generated, and those around them that steer."""

    start: int  # First frame of the gap.
    end: int  # The frame after its last.
    total: int  # Frames of the whole motion.

    @property
    def before(self) -> int:
        """Tokens that are known before the gap."""
        return min(TOKENS, self.start // STRIDE)

    @property
    def window(self) -> tuple[int, int]:
        """First frame that is generated or known by its latents, and the frame after the last.

        A frame or two beside the gap that are too few for a token belong to it: they are goals.
        """
        first = self.start - (STRIDE * self.before or min(self.start, 1))
        follow = STRIDE * self.after
        return first, (self.resumes + follow if follow else min(self.end + 1, self.total))

    @property
    def resumes(self) -> int:
        """The first frame after the gap at which a token begins."""
        return self.start + -(-(self.end - self.start) // STRIDE) * STRIDE

    @property
    def after(self) -> int:
        """Tokens that are known after the gap."""
        return max(0, min(TOKENS, (self.total - self.resumes) // STRIDE))


def generate_edited(
    generator: Generator,
    motion: Motion,
    prompt: str,
    between: tuple[float, float],
    seed: int = 0,
    steps: int | None = None,
    guidance: float | None = None,
    parts: Sequence[str] = (),
) -> Motion:
    """Generates a part of a motion again; all frames outside of it stay bit-identical.

    Args:
        generator: The model.
        motion: The motion, with the frame rate and skeleton of the model's.
        prompt: What the person does in that part.
        between: Its start and end, seconds.
        seed: Seed of the noise.
        steps: Sampling steps; by default the model's own.
        guidance: Guidance scale; by default the model's own.
        parts: Parts of the body that change, such as `left_arm`; all other joints stay
            bit-identical. By default the whole body changes.

    Raises:
        InputError: The motion is of another kind, the times are not within it, or there is no such
            part.
        ModelError: The model has no `pullback.onnx`.
    """
    sampling = generator.card.sampling.but(steps, guidance, None)
    _check_like(generator, motion)
    gap, changed = gap_between(motion, between), parts_named(parts, motion.skeleton)
    filled = _filled(generator, motion, gap, prompt, seed, sampling)
    if not changed:
        return filled
    joints, frames = motion.joints.copy(), slice(gap.start, gap.end)
    joints[frames] = with_parts(joints[frames], filled.joints[frames], changed, motion.skeleton)
    return replace(filled, joints=joints)


def generate_between(
    generator: Generator,
    start: Motion,
    end: Motion,
    seconds: float,
    prompt: str = ON_THE_WAY,
    seed: int = 0,
    steps: int | None = None,
    guidance: float | None = None,
    align: bool = False,
) -> Motion:
    """Generates what leads from one motion or pose to another; both are part of the result.

    Args:
        generator: The model.
        start: A motion, or a pose of one frame, whose frames stay the same numbers.
        end: Likewise. Where it is says where the motion has to get.
        seconds: Length of the transition.
        prompt: What the person does in between.
        seed: Seed of the noise.
        steps: Sampling steps; by default the model's own.
        guidance: Guidance scale; by default the model's own.
        align: Put the end where the start leads, facing its way.

    Raises:
        InputError: The motions are of another kind.
        ModelError: The model has no `pullback.onnx`.

    Warns:
        CleanUpWarning: The end is too far away to walk there in the time, and was aligned.
    """
    sampling = generator.card.sampling.but(steps, guidance, None)
    _check_like(generator, start)
    joints, gap = in_between(start, end, seconds, align)
    return _filled(generator, replace(start, joints=joints), gap, prompt, seed, sampling)


def generate_joined(
    generator: Generator,
    motions: Sequence[Motion],
    seconds: float,
    prompt: str = ON_THE_WAY,
    seed: int = 0,
    steps: int | None = None,
    guidance: float | None = None,
) -> Motion:
    """Generates what leads from each motion to the next, which is put where the one before leads.

    Args:
        generator: The model.
        motions: Motions of the model's rate and skeleton, at least one.
        seconds: Length of each transition; 0 joins by cuts.
        prompt: What the person does in between.
        seed: Seed of the noise.
        steps: Sampling steps; by default the model's own.
        guidance: Guidance scale; by default the model's own.

    Raises:
        InputError: There is no motion, or they are of another kind.
        ModelError: The model has no `pullback.onnx`.
    """
    if not motions:
        raise InputError("no motion to join, expected at least one")
    whole, *others = motions
    if seconds == 0:
        return whole.joined(*others)
    captions = [whole.caption]
    for number, motion in enumerate(others):
        options = prompt, seed + number, steps, guidance, True
        whole = generate_between(generator, whole, motion, seconds, *options)
        captions.append(motion.caption)
    return replace(whole, caption=", then ".join(text for text in captions if text))


def put_after(before: Motion, motion: Motion, seconds: float) -> Motion:
    """Returns a motion where another one leads: facing its way, as far on as both go in the time.

    Args:
        before: What comes before.
        motion: What follows.
        seconds: Time between the two.
    """
    few = max(1, round(_PACE * before.fps))
    flat = np.array([1.0, 0.0, 1.0])
    last, first = before.joints[-few - 1 :].astype(np.float64), motion.joints[: few + 1]
    angle = heading(last[-1], before.skeleton) - heading(first[0], motion.skeleton)
    place = first[0, 0] * flat
    turned = turn(motion.joints.astype(np.float64) - place, np.asarray(angle))
    steps = [(part[-1, 0] - part[0, 0]) * flat for part in (last, turned[: few + 1])]
    times = [max(len(part) - 1, 1) / before.fps for part in (last, first)]
    pace = np.mean([step / time for step, time in zip(steps, times, strict=True)], axis=0)
    joints = turned + last[-1, 0] * flat + seconds * pace
    return motion.with_joints(joints.astype(np.float32), motion.caption)


# Seconds over which the pace of an end is measured.
_PACE = 0.25

# Meters per second, besides the pace of both ends, at which a person gets elsewhere: up to it
# transitions keep their feet on the floor, from 2 m/s on they fly.
_ASIDE = 1.4

# Meters per second that a pose, whose pace nobody knows, may be left or come to with.
_RUN = 3.0


def gap_between(motion: Motion, between: tuple[float, float]) -> Gap:
    """Returns the frames between two times.

    Raises:
        InputError: The times are not within the motion, or nothing of it would be left.
    """
    start, end = between
    if not 0 <= start < end <= motion.seconds + 1e-6:
        raise InputError(
            f"between {start:g} and {end:g} s: expected two ascending times from 0 to "
            f"{motion.seconds:g} s, the length of the motion"
        )
    gap = Gap(round(start * motion.fps), min(round(end * motion.fps), len(motion)), len(motion))
    if gap.end - gap.start < 1:
        raise InputError(f"between {start:g} and {end:g} s there is no frame")
    if gap.start == 0 and gap.end == len(motion):
        raise InputError("nothing of the motion would be left: generate a new one instead")
    return gap


def edited(
    joints: Joints,
    gap: Gap,
    motion: Callable[[int], DecodedMotion],
    sample: Sample,
    fps: float,
    skeleton: Skeleton,
) -> Joints:
    """Returns joints with a gap generated again; all other frames are bit-identical.

    Args:
        joints: The motion, whose gap is not read.
        gap: The frames that are generated.
        motion: Makes a decoder for so many frames.
        sample: Samples latents.
        fps: Frames per second.
        skeleton: Of the joints.
    """
    (first, last), whole = gap.window, joints.astype(np.float64)
    frames, before, after = last - first, gap.before, gap.after
    # Where nothing is known before the gap, what follows says where the motion is.
    decoded = motion(frames)
    tokens = -(-frames // STRIDE)
    latents, is_known = np.zeros((tokens, latent_width(decoded))), np.zeros(tokens, bool)
    if before:
        latents[:before] = fit_latents(motion(STRIDE * before), whole[first : gap.start])
        is_known[:before] = True
    if after:
        latents[tokens - after :] = fit_latents(motion(STRIDE * after), whole[gap.resumes : last])
        # The first is free where others follow: fitted as the start of a motion, it would draw
        # limbs too long beside what is generated before it.
        is_known[tokens - max(after - 1, 1) :] = True
    residual = _seam_goals(whole, gap, decoded, latents, is_known, skeleton)
    correction = Correction(decoded, residual, latents, is_known, ReachSettings(updates=1))
    keep = replace(correction, residual=None)
    z = keep(sample(frames, correction)[None])[0]
    z = reach(z, decoded, residual, ~is_known, ReachSettings(updates=6))
    clip = Motion(decoded.joints(z).astype(np.float32), fps, skeleton)
    clip = clean(clip).joints.astype(np.float64)
    inside = slice(gap.start - first, gap.end - first)
    anchor = slice(0, inside.start) if inside.start else slice(inside.stop, frames)
    clip = _aligned(clip, clip[anchor], whole[first:last][anchor], inside.start > 0)
    before, after = whole[max(0, gap.start - 3) : gap.start], whole[gap.end : gap.end + 3]
    piece = inertialized(clip[inside], before, after, skeleton, _SEAM)
    piece = _supported(piece, clip[inside], before, after, fps, skeleton)
    return np.concatenate([joints[: gap.start], piece.astype(joints.dtype), joints[gap.end :]])


def _supported(
    piece: Joints,
    generated: Joints,
    before: Float[np.ndarray, "earlier joints 3"],
    after: Float[np.ndarray, "later joints 3"],
    fps: float,
    skeleton: Skeleton,
) -> Joints:
    """Returns a piece as near to the floor as it was before its seams were met.

    Directions of bones that come from the seams say nothing of the floor: feet went below it by
    14 cm and were 10 cm above it. A body that hovers is lowered, feet that sink are lifted.

    Args:
        piece: The frames between the seams, which meet them.
        generated: The same frames as they were generated.
        before: Frames before them.
        after: Frames after them.
        fps: Frames per second.
        skeleton: Of the joints.
    """
    lowest, level = (part[..., 1].min(axis=1) for part in (piece, generated))
    u = np.arange(1, len(piece) + 1) / (_SEAM + 1)
    for side, near in ((before[-1:], u), (after[:1], u[::-1])):
        for pose in side[..., 1].min(axis=1):  # what was there decays from the seam
            share = 1 - quintic(np.minimum(near, 1))
            level = level + share * np.maximum(0, pose - level)
    hovers = np.maximum(0, lowest - level)
    down = np.minimum(gaussian(hovers, max(1, round(0.1 * fps))), hovers)
    floor = min([0.0, *(side[..., 1].min() for side in (before, after) if len(side))])
    below = np.clip(floor - lowest, 0, _WHOLE)
    inner = np.ones(len(piece))
    for side, near in ((before, u), (after, u[::-1])):  # nothing jumps at a seam
        inner *= quintic(np.minimum(near * _SEAM / _LIFTED, 1)) if len(side) else 1
    up = inner * upper_envelope(below, max(1, round(0.15 * fps)))
    supported = piece + (up - inner * down)[:, None, None] * (0, 1, 0)
    return lift_feet(supported, fps, skeleton, floor, inner)


def in_between(
    start: Motion, end: Motion, seconds: float, align: bool = False
) -> tuple[Joints, Gap]:
    """Returns two motions with empty frames between them, and these frames.

    Args:
        start: A motion, or a pose of one frame.
        end: Likewise; where it is on the floor says where the motion has to get.
        seconds: How long the frames between take.
        align: Put the end where the start leads, facing its way.

    Raises:
        InputError: The motions do not fit, or there is no time between them.

    Warns:
        CleanUpWarning: The end is too far away to walk there in the time, and was aligned.
    """
    if (start.fps, start.skeleton.names) != (end.fps, end.skeleton.names):
        raise InputError(
            f"start has {start.fps:g} frames per second of skeleton {start.skeleton.name!r}, end "
            f"{end.fps:g} of {end.skeleton.name!r}: resample or convert one of them"
        )
    count = round(seconds * start.fps) if np.isfinite(seconds) else 0
    if count < 2:
        raise InputError(f"{seconds:g} seconds between: expected {2 / start.fps:g} or more")
    aligned = put_after(start, end, seconds)
    few = max(1, round(_PACE * start.fps))
    ends = start.joints[-few - 1 :, 0], end.joints[: few + 1, 0]
    paces = [
        _floor_distance(part[-1], part[0]) / (len(part) - 1) if len(part) > 1 else _RUN / start.fps
        for part in ends
    ]
    far = _floor_distance(end.joints[0, 0], aligned.joints[0, 0])
    beyond = _floor_distance(end.joints[0, 0], start.joints[-1, 0]) > np.mean(paces) * count
    if far > _ASIDE * seconds + 0.1 and beyond and not align:
        warnings.warn(
            f"the second motion begins {far:.1f} m from where the first one leads, too far to walk "
            f"in {seconds:g} s: it was put there, facing its way; more time leaves it in its place",
            CleanUpWarning,
            stacklevel=3,
        )
        align = True
    end = aligned if align else end
    blank = np.zeros((count, *start.joints.shape[1:]), np.float32)
    joints = np.concatenate([start.joints, blank, end.joints])
    return joints, Gap(len(start), len(start) + count, len(joints))


def _floor_distance(a: Float[np.ndarray, " 3"], b: Float[np.ndarray, " 3"]) -> float:
    return float(np.linalg.norm((a - b)[[0, 2]]))


def _check_like(generator: Generator, motion: Motion) -> None:
    """Raises InputError if a motion has another skeleton or frame rate than the model's."""
    fps, skeleton = generator.representation.fps, generator.representation.skeleton
    name = generator.card.name
    if motion.skeleton.names != skeleton.names:
        raise InputError(
            f"the motion's skeleton is {motion.skeleton.name!r}, model {name!r} "
            f"moves {skeleton.name!r}; convert it first: latentmotion.to_humanml3d"
        )
    if motion.fps != fps:
        raise InputError(
            f"the motion has {motion.fps:g} frames per second, model {name!r} "
            f"makes {fps:g}; call motion.resampled({fps:g}) first"
        )


def _filled(
    generator: Generator, motion: Motion, gap: Gap, prompt: str, seed: int, sampling: Sampling
) -> Motion:
    """Returns a motion with its gap generated."""
    first, last = gap.window
    request = GenerationRequest((prompt,), (last - first,), (seed,), sampling)
    request.check(generator.card, motion.fps)
    sample_latents, decoders = latents_of(generator, request), decoders_of(generator)
    joints = edited(motion.joints, gap, decoders, sample_latents, motion.fps, motion.skeleton)
    caption = ", ".join(text for text in (motion.caption, prompt) if text)
    filled = motion.with_joints(joints, caption)
    return replace(filled, metadata={**filled.metadata, **metadata_of(generator, seed, sampling)})


def _seam_goals(
    own: Joints,
    gap: Gap,
    motion: DecodedMotion,
    known: Float[np.ndarray, "tokens width"],
    is_known: Bool[np.ndarray, " tokens"],
    skeleton: Skeleton,
) -> TargetResidual:
    """Returns what brings the frames beside the gap to their places in the generated window."""
    first, last = gap.window
    if gap.start == 0 or gap.end == gap.total:
        return TargetResidual(NO_TARGETS, skeleton)
    if gap.before:
        # Where the known frames are, in the place and direction that their latents give them.
        shown = motion.joints(np.where(is_known[:, None], known, 0.0))
        there = slice(0, STRIDE * gap.before)
        window = _aligned(own[first:last], own[first:last][there], shown[there], True)
    else:
        pose = own[first:last]
        window = turn(pose - pose[0, 0] * (1, 0, 1), -heading(pose[0], skeleton))
    frames, joints, turned = [], [], []
    if not gap.before:
        frames += [0] * len(skeleton)
        joints += list(range(len(skeleton)))
    if gap.after:
        late = [gap.resumes - first, min(gap.resumes - first + 8, last - first - 1)]
        frames, joints, turned = [*frames, *late], [*joints, 0, 0], late[:1]
    else:
        frames += [last - first - 1] * len(skeleton)
        joints += list(range(len(skeleton)))
    targets = Targets(
        np.array(frames),
        np.array(joints),
        window[frames, joints],
        np.array(turned, int),
        heading(window[turned], skeleton) if turned else np.zeros(0),
    )
    return TargetResidual(targets, skeleton)


def _aligned(
    moved: Joints,
    part: Float[np.ndarray, "few joints 3"],
    goal: Float[np.ndarray, "few joints 3"],
    at_end: bool,
) -> Joints:
    """Returns joints turned about the vertical and shifted so that a part of them meets its goal.

    Args:
        moved: What is moved.
        part: The part as it is.
        goal: Where it should be.
        at_end: Whether the last frames of the part count, or its first.
    """
    few = slice(-2, None) if at_end else slice(0, 2)
    points, other = part[few].reshape(-1, 3), goal[few].reshape(-1, 3)
    center, place = points.mean(axis=0), other.mean(axis=0)
    a, b = points - center, other - place
    angle = np.arctan2(
        (a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum(), (a[:, 0] * b[:, 0] + a[:, 2] * b[:, 2]).sum()
    )
    flat = np.array([1.0, 0.0, 1.0])
    return turn(moved - center * flat, np.asarray(angle)) + place * flat


@dataclass(frozen=True)
class BodyPart:
    """A part of the body, by names of joints."""

    # Those that move, from the body outward; their parents are known before them.
    joints: tuple[str, ...]
    carried_by: tuple[str, ...]  # Those that say how the body is turned that carries it.


_CHEST = ("spine3", "neck", "left_shoulder", "right_shoulder", "left_collar", "right_collar")
_HIPS = ("pelvis", "left_hip", "right_hip", "spine1")
_TRUNK = ("spine2", "spine3", "neck", "head", "left_collar", "right_collar")
_ARM, _LEG = ("elbow", "wrist"), ("knee", "ankle", "foot")


def _of(joints: Sequence[str], *sides: str) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}" for side in sides for joint in joints)


# The parts that can be generated alone.
PARTS: Mapping[str, BodyPart] = {
    "left_arm": BodyPart(_of(_ARM, "left"), _CHEST),
    "left_leg": BodyPart(_of(_LEG, "left"), _HIPS),
    "right_arm": BodyPart(_of(_ARM, "right"), _CHEST),
    "right_leg": BodyPart(_of(_LEG, "right"), _HIPS),
    "arms": BodyPart(_of(_ARM, *SIDES), _CHEST),
    "legs": BodyPart(_of(_LEG, *SIDES), _HIPS),
    "head": BodyPart(("head",), _CHEST),
    "upper_body": BodyPart((*_TRUNK, *_of(("shoulder", *_ARM), *SIDES)), _HIPS),
}


def parts_named(names: Sequence[str], skeleton: Skeleton) -> list[BodyPart]:
    """Returns parts of the body.

    Raises:
        InputError: A name is unknown, a part is named twice or within another, or the skeleton
            lacks its joints.
    """
    if isinstance(names, str):
        raise InputError(f"parts is {names!r}: expected a list of names, such as [{names!r}]")
    chosen, owners = [], dict[str, str]()
    for name in names:
        part = named("part", name, PARTS)
        lacking = [joint for joint in part.joints + part.carried_by if joint not in skeleton.names]
        if lacking:
            raise InputError(f"skeleton {skeleton.name!r} lacks {lacking[0]}, which {name} needs")
        for joint in part.joints:
            if joint in owners:
                raise InputError(f"{joint} belongs to both {owners[joint]} and {name}: leave one")
            owners[joint] = name
        chosen.append(part)
    return chosen


def with_parts(own: Joints, other: Joints, parts: Sequence[BodyPart], skeleton: Skeleton) -> Joints:
    """Returns a motion with some parts of another; all other joints are the same numbers.

    Args:
        own: The motion that is kept.
        other: The motion that has the parts.
        parts: The parts.
        skeleton: Of both.
    """
    moved, names = own.astype(np.float64), skeleton.names
    for part in parts:
        carried = [names.index(name) for name in part.carried_by]
        # The rotations that bring what carries the part onto its own place best (Kabsch 1976).
        there, here = (
            points[:, carried].astype(np.float64) - points[:, carried].mean(axis=1, keepdims=True)
            for points in (other, own)
        )
        turned = nearest_rotation(np.einsum("tci,tcj->tij", here, there))
        for name in part.joints:
            joint = names.index(name)
            parent = skeleton.parents[joint]
            bone = np.einsum("tij,tj->ti", turned, other[:, joint] - other[:, parent])
            length = np.linalg.norm(own[:, joint] - own[:, parent], axis=-1, keepdims=True)
            bone *= length / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-9)
            moved[:, joint] = moved[:, parent] + bone
    changed = [names.index(name) for part in parts for name in part.joints]
    replaced = own.copy()
    replaced[:, changed] = moved[:, changed]
    return replaced
