"""Motion without an end, in bounded memory; decoding in windows; loops.

A decoder of convolutions sees a bounded number of tokens to either side. So latents are decoded in
windows with that margin, and the frames are those of the whole. A stream samples tokens with the
last ones known, decodes what has enough of a future, and carries place and heading along. All that
it remembers is its state: immutable, saved and resumed to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from latentmotion.control.generator import (
    Generator,
    SampleKnown,
    decoders_of,
    known_latents_of,
    latents_of,
    margin_of,
    metadata_of,
)
from latentmotion.control.reach import DecodedMotion
from latentmotion.engine.request import USUAL_SECONDS, GenerationRequest
from latentmotion.kinematics.skeleton import Joints
from latentmotion.model.config import STRIDE
from latentmotion.motion import Motion
from latentmotion.representation.canonical import turn
from latentmotion.representation.interface import Representation

Latents = Float[np.ndarray, "tokens width"]

KNOWN, CALL = 5, 15  # Tokens of a call that are known from the call before, and all of them.

# Tokens that frames wait for, 0.4 s: with fewer, frames shake where they are joined.
LOOK_AHEAD = 2

# Tokens that are sampled again where a loop is joined.
_SEAM = 6


def generate_stream(
    generator: Generator,
    prompt: str,
    seed: int = 0,
    steps: int | None = None,
    guidance: float | None = None,
    state: StreamState | None = None,
) -> MotionStream:
    """Returns an endless motion: an iterator of its next two seconds, in constant memory.

    Args:
        generator: The model.
        prompt: What the person does; `say` of the stream changes it.
        seed: Seed of the noise.
        steps: Sampling steps, 2 or more; by default the model's own.
        guidance: Guidance scale; by default the model's own.
        state: Where an earlier stream is resumed.

    Raises:
        InputError: A number is out of range.
        ModelError: The model has no `pullback.onnx`.
    """
    sampling = generator.card.sampling.but(steps, guidance, None)
    space, motion = generator.representation, decoders_of(generator)
    sees = margin_of(generator)

    def advance(state: StreamState, prompt: str, seed: int) -> tuple[Joints, StreamState]:
        request = GenerationRequest((prompt,), (STRIDE * CALL,), (seed,), sampling)
        request.check(generator.card, space.fps)
        return advanced(state, known_latents_of(generator, request), motion, space, sees, seed)

    first = state or StreamState.start(generator.card.latents.width)
    return MotionStream(prompt, seed, first, advance, space)


def generate_loop(
    generator: Generator,
    prompt: str,
    seconds: float | None = None,
    seed: int = 0,
    steps: int | None = None,
    guidance: float | None = None,
    straight: bool = True,
) -> Motion:
    """Generates one turn of a seamless cycle, such as a step of a walk.

    Its last frame is its first, farther along its path, as programs that play loops expect;
    `cleaned(in_place=True)` takes the path away. Clean-up keeps the ends together.

    Args:
        generator: The model.
        prompt: What the person does.
        seconds: Length of a turn, rounded to 0.2 s; by default as predicted from the prompt.
        seed: Seed of the noise.
        steps: Sampling steps, 2 or more; by default the model's own.
        guidance: Guidance scale; by default the model's own.
        straight: Whether it ends facing as it begins, so that many turns go straight ahead.

    Raises:
        InputError: A number is out of range.
        ModelError: The model has no `pullback.onnx`.
    """
    sampling = generator.card.sampling.but(steps, guidance, None)
    space, motion = generator.representation, decoders_of(generator)
    if seconds is None:
        (seconds,) = generator.usual_seconds([prompt]) or [USUAL_SECONDS]
    tokens = max(1, round(seconds * space.fps / STRIDE))
    request = GenerationRequest((prompt,), (STRIDE * tokens,), (seed,), sampling)
    request.check(generator.card, space.fps)
    z = latents_of(generator, request)(STRIDE * tokens, lambda clean: clean)
    sample_known = known_latents_of(generator, request)
    features = looped(z, sample_known, motion, margin_of(generator), seed)
    if straight:  # what it turns by is given back evenly
        yaw = space.blocks["yaw_velocity"]
        features[:, yaw] -= features[:, yaw].mean(axis=0)
    closed = np.concatenate([features, features[:1]])
    joints = np.asarray(space.decode(closed), np.float32)
    about = {**metadata_of(generator, seed, sampling), "loop": True}
    return Motion(joints, space.fps, space.skeleton, prompt, about)


def decode_in_windows(
    z: Latents, motion: Callable[[int], DecodedMotion], sees: int, window: int = 32
) -> Float[np.ndarray, "frames features"]:
    """Returns the features of latents of any length, decoded in windows: those of the whole.

    Args:
        z: Latents in the denoiser's scale.
        motion: Makes a decoder for so many frames.
        sees: How many tokens to either side a frame depends on.
        window: Tokens whose frames are decoded at once.
    """
    pieces = []
    for start in range(0, len(z), window):
        first, last = max(0, start - sees), min(len(z), start + window + sees)
        features = motion(STRIDE * (last - first)).decode(z[first:last])
        size = min(window, len(z) - start)
        pieces.append(features[STRIDE * (start - first) :][: STRIDE * size])
    return np.concatenate(pieces)


@dataclass(frozen=True, eq=False)
class StreamState:
    """All that a stream remembers between two calls."""

    latents: Latents  # The last ones, as far back as frames depend on them.
    emitted: int  # Number of these that have become frames.
    yaw: float  # Heading at which the next frame begins, radians.
    place: tuple[float, float]  # x and z of the pelvis there, meters.
    calls: int  # Number of times that tokens have been sampled.

    @classmethod
    def start(cls, width: int) -> StreamState:
        """Returns the state of a stream that begins."""
        return cls(np.zeros((0, width)), 0, 0.0, (0.0, 0.0), 0)


def advanced(
    state: StreamState,
    sample: SampleKnown,
    motion: Callable[[int], DecodedMotion],
    space: Representation,
    sees: int,
    seed: int,
) -> tuple[Joints, StreamState]:
    """Returns the next frames of a stream, and the state after them.

    Args:
        state: The state before.
        sample: Samples tokens with known ones.
        motion: Makes a decoder for so many frames.
        space: The model's representation.
        sees: How many tokens to either side a frame depends on.
        seed: Of the whole stream.
    """
    width = state.latents.shape[1]
    count = min(KNOWN, len(state.latents))
    window = np.zeros((CALL, width))
    window[:count] = state.latents[len(state.latents) - count :]
    draw = int(np.random.SeedSequence([seed, state.calls]).generate_state(1)[0])
    fresh = sample(window, np.arange(CALL) < count, draw)[count:]
    latents = np.concatenate([state.latents, fresh])
    ready = len(latents) - LOOK_AHEAD
    features = motion(STRIDE * len(latents)).decode(latents)
    new = features[STRIDE * state.emitted : STRIDE * ready]
    joints, yaw, place = placed(new, space, state.yaw, state.place)
    dropped = max(0, ready - sees)
    after = replace(
        state,
        latents=latents[dropped:],
        emitted=ready - dropped,
        yaw=yaw,
        place=place,
        calls=state.calls + 1,
    )
    return joints, after


def placed(
    features: Float[np.ndarray, "frames features"],
    space: Representation,
    yaw: float,
    place: tuple[float, float],
) -> tuple[Joints, float, tuple[float, float]]:
    """Returns the joints of features that begin somewhere, and where the frame after them begins.

    Args:
        features: In their own units.
        space: What they mean.
        yaw: Heading at which they begin, radians.
        place: x and z of the pelvis there.
    """
    joints = space.decode(np.concatenate([features, features[-1:]]))
    joints = turn(joints, np.array(yaw)) + np.array([place[0], 0.0, place[1]])
    turned = -2 * float(features[:, space.blocks["yaw_velocity"]].sum())
    end = joints[-1, 0]
    return joints[:-1], yaw + turned, (float(end[0]), float(end[2]))


@dataclass
class MotionStream:
    """An endless motion: `next(stream)` is its next two seconds or so.

    Closing it, or leaving its `with`, changes nothing: it has no thread and holds no file.
    """

    prompt: str  # What the person does; `say` changes it.
    seed: int
    state: StreamState  # All that it remembers; set it to go back, or on from a file.
    # State, prompt and seed to frames and the state after them.
    advance: Callable[[StreamState, str, int], tuple[Float[np.ndarray, "_ joints 3"], StreamState]]
    space: Representation

    def __iter__(self) -> Iterator[Motion]:
        return self

    def __next__(self) -> Motion:
        joints, self.state = self.advance(self.state, self.prompt, self.seed)
        joints = joints.astype(np.float32)
        return Motion(joints, self.space.fps, self.space.skeleton, self.prompt)

    def __enter__(self) -> MotionStream:
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def say(self, prompt: str) -> None:
        """Changes what the person does, from the next tokens on."""
        self.prompt = prompt


def looped(
    z: Latents, sample: SampleKnown, motion: Callable[[int], DecodedMotion], sees: int, seed: int
) -> Float[np.ndarray, "frames features"]:
    """Returns the features of one turn of a loop: after the last frame the first may follow.

    The tokens where it is joined are sampled anew between those around them; then the turn is
    decoded with itself before and after it.

    Args:
        z: Latents in the denoiser's scale.
        sample: Samples tokens with known ones.
        motion: Makes a decoder for so many frames.
        sees: How many tokens to either side a frame depends on.
        seed: Of the tokens that are sampled anew.
    """
    count, half = len(z), len(z) // 2
    seam = min(_SEAM, count // 2)
    rolled = np.roll(z, half, axis=0)
    is_known = np.ones(count, bool)
    is_known[half - seam // 2 : half - seam // 2 + seam] = False
    z = np.roll(sample(rolled, is_known, seed), -half, axis=0)
    turns = -(-sees // count)
    whole = motion(STRIDE * count * (2 * turns + 1)).decode(np.tile(z, (2 * turns + 1, 1)))
    return whole[STRIDE * count * turns :][: STRIDE * count]
