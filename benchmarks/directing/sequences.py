"""Sequences: timelines of prompts, streams of minutes, loops."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from benchmarks.directing.bench import CLIP, Bench, Rows, beside, blended, jerk
from latentmotion.control.generator import decoders_of, margin_of
from latentmotion.control.stream import decode_in_windows, generate_loop, generate_stream
from latentmotion.control.timeline import generate_timeline
from latentmotion.model.config import STRIDE
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn

SECONDS, CHAIN = 3.0, 3  # Length of a prompt of a timeline, and their number.

_HALF = 15  # Frames to either side of a transition, as FlowMDM counts them.

CYCLES = (
    "a person walks forward",
    "a person runs forward",
    "a person walks backward",
    "a person jogs in place",
    "a person waves with the right hand",
    "a person marches",
    "a person does jumping jacks",
    "a person punches",
)
STREAMED = (
    "a person walks forward",
    "a person runs forward",
    "a person waves",
    "a person dances",
    "a person walks in a circle",
)
TURNS = (0.8, 2.4, 3.2)  # Seconds of a loop's turn, in turns.


def timeline_rows(bench: Bench) -> Rows:
    """Measures timelines beside their prompts alone, cut together, and recordings."""
    texts = [each.text for each in bench.recordings()]
    draw, frames = np.random.default_rng(4), round(SECONDS * 20)
    drawn = [[texts[n] for n in draw.integers(len(texts), size=CHAIN)] for _ in texts]
    chains, chain_of = bench.repeated(drawn)
    whole = [
        generate_timeline(bench.generate, [(text, SECONDS) for text in chain], seed).cleaned()
        for seed, chain in enumerate(chains)
    ]
    singles = [
        [bench.generate(text, SECONDS, CHAIN * seed + n, takes=1) for n, text in enumerate(chain)]
        for seed, chain in enumerate(chains)
    ]
    cut = [_cut_together(parts) for parts in singles]
    long = [each.motion for each in bench.recordings(5.0, 9.0)]
    windows = [jerk(m.joints)[len(m) // 2 - _HALF : len(m) // 2 + _HALF] for m in long]
    usual = float(np.mean([jerk(motion.joints).mean() for motion in long]))
    flat = [text for chain in chains for text in chain]

    def row(motions: Sequence[Motion]) -> dict[str, np.ndarray]:
        parts = [m.cut(n * SECONDS, (n + 1) * SECONDS) for m in motions for n in range(CHAIN)]
        seams = [
            jerk(m.joints)[frames * n - _HALF : frames * n + _HALF]
            for m in motions
            for n in range(1, CHAIN)
        ]
        found = bench.usual_columns(parts, flat)
        ratios = beside(found, alone, "alone", ["R@3", "FID"])
        return {**ratios, **_transitions(seams, usual), CLIP: chain_of}

    alone = bench.usual_columns([motion for parts in singles for motion in parts], flat)
    alone = {**alone, CLIP: chain_of}
    return {
        "real motion": {**bench.usual_columns(long), **_transitions(windows, usual)},
        "each prompt alone": alone,
        "alone, joined, half a second interpolated": row(cut),
        "timeline": row(whole),
    }


def _transitions(windows: Sequence[np.ndarray], usual: float) -> dict[str, np.ndarray]:
    """Returns the peak of the jerk, and the area between it and its mean in real motion."""
    return {
        "Peak jerk, m": np.array([window.max() for window in windows]),
        "Peak jerk, m, median": np.array([window.max() for window in windows]),
        "AUJ, m": np.array([np.abs(window - usual).sum() for window in windows]),
    }


def _cut_together(parts: Sequence[Motion]) -> Motion:
    """Returns motions one after the other, each turned and moved to the end of that before."""
    joints, skeleton = parts[0].joints.astype(np.float64), parts[0].skeleton
    for part in parts[1:]:
        own, end = part.joints.astype(np.float64), joints[-1]
        own = turn(own - own[0, 0] * (1, 0, 1), heading(end, skeleton) - heading(own[0], skeleton))
        joined = np.concatenate([joints, own + end[0] * (1, 0, 1)])
        joints = blended(joined, len(joints) - 5, len(joints) + 5)
    return replace(parts[0], joints=joints.astype(np.float32))


def stream_rows(bench: Bench) -> Rows:
    """Measures the beginning, the middle and the end of long streams, and decoding in windows."""
    count = max(2, bench.count // 8)
    minutes = min(10.0, bench.count / 4)
    pieces: dict[str, list[Motion]] = {"first 20 s": [], "middle 20 s": [], "last 20 s": []}
    spent, states, texts = [], [], []
    for number in range(count * bench.seeds):
        prompt = STREAMED[number // bench.seeds % len(STREAMED)]
        texts += [prompt] * 5
        stream = generate_stream(bench.generate, prompt, number)
        motions, calls = [next(stream)], []
        while sum(map(len, motions)) < 1200 * minutes:
            start = time.process_time()
            motions.append(next(stream))
            calls.append(1e3 * (time.process_time() - start))
        spent.append(float(np.median(calls)))
        states.append(stream.state.latents.nbytes / 1024)
        joints = np.concatenate([motion.joints for motion in motions])
        half = len(joints) // 2
        for name, start in zip(pieces, (0, half - 200, len(joints) - 400), strict=True):
            for first in range(start, start + 400, 80):
                pieces[name].append(replace(motions[0], joints=joints[first : first + 80]))
    alone = [
        bench.generate(text, 4.0, number, takes=1, clean_up=None)
        for number, text in enumerate(texts)
    ]
    stream_of = np.arange(count * bench.seeds)
    rows = {
        name: {**bench.usual_columns(motions, texts), CLIP: stream_of}
        for name, motions in [("motions of 4 s", alone), *pieces.items()]
    }
    rows[f"all {minutes:g} min"] = {"CPU ms a call": np.array(spent), "State, kB": np.array(states)}
    motion, space, off = decoders_of(bench.generate), bench.generate.representation, []
    for seed in (0, 1):  # 60 s of latents; positions are compared before they are summed up
        z = np.random.default_rng(seed).standard_normal((300, bench.generate.card.latents.width))
        whole = motion(STRIDE * len(z)).decode(z)
        windows = decode_in_windows(z, motion, margin_of(bench.generate))
        off.append(1000 * float(np.abs(whole - windows)[:, space.blocks["positions"]].max()))
    rows["decoded in windows"] = {"Off, mm, worst": np.array(off)}
    return rows


def loop_rows(bench: Bench) -> Rows:
    """Measures the seam of loops beside motions that are repeated, and interpolated ones."""
    turns = [(CYCLES[n % len(CYCLES)], TURNS[n % len(TURNS)]) for n in range(bench.count)]
    every, loop_of = bench.repeated(turns)
    asked = [(*turn, seed) for seed, turn in enumerate(every)]
    loops = [generate_loop(bench.generate, *each) for each in asked]
    plain = [bench.generate(*each, takes=1, clean_up=None) for each in asked]
    poses = [_local(motion) for motion in plain]
    # The last third of a second goes straight to the first frame.
    closed = [blended(np.concatenate([own, own[:1]]), len(own) - 6, len(own))[:-1] for own in poses]
    return {
        name: {**_seam(made), CLIP: loop_of}
        for name, made in (
            ("motion, repeated", poses),
            ("motion, end interpolated", closed),
            ("loop", [_local(motion)[:-1] for motion in loops]),  # the last frame is the first
        )
    }


def _local(motion: Motion) -> Float[np.ndarray, "frames joints 3"]:
    """Returns poses about the pelvis, facing +z."""
    joints = motion.joints.astype(np.float64)
    return turn(joints - joints[:, :1] * (1, 0, 1), -heading(joints, motion.skeleton)[:, None])


def _seam(turns: Sequence[Float[np.ndarray, "_ joints 3"]]) -> dict[str, np.ndarray]:
    seams = np.array([jerk(np.concatenate([own[-3:], own[:3]])).max() for own in turns])
    inner = np.array([jerk(own).max() for own in turns])
    apart = [100 * np.linalg.norm(own[-1] - own[0], axis=-1).mean() for own in turns]
    return {
        "Seam jerk, m": seams,
        "Inner jerk, m": inner,
        "Seam / inner, median": seams / np.maximum(inner, 1e-3),
        "Last to first frame, cm": np.array(apart),
    }
