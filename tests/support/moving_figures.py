"""A tiny prepared folder of synthetic figures that sway, for tests of training."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from latentmotion.data.clip import Source, Split
from latentmotion.data.store import StoredClip, StoredMotion, stored_normalizer, write_dataset
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.interface import Normalizer


def joints_of(generator: np.random.Generator, frames: int) -> np.ndarray:
    """Every joint swings with a frequency and phase of its own while the root walks forward."""
    time = np.arange(frames)[:, None, None] / 20
    frequency, phase = generator.uniform(0.3, 1.5, (2, 1, len(HUMANML3D), 3))
    angles = 0.3 * np.sin(2 * np.pi * (frequency * time + phase))
    root = np.zeros((frames, 3))
    root[:, 1] = 0.95
    root[:, 2] = generator.uniform(0, 1.5) * time[:, 0, 0]
    return HUMANML3D.forward_kinematics(matrix_from_axis_angle(angles), root)


def write_moving_figures(folder: Path, train: int = 10, val: int = 3, test: int = 0) -> Path:
    """Writes a prepared folder of clips of 24 to 60 frames; returns its path."""
    generator = np.random.default_rng(0)
    counts: dict[Split, int] = {"train": train, "val": val, "test": test}
    splits: list[Split] = [split for split, count in counts.items() for _ in range(count)]
    motions = [motion(generator, number, split) for number, split in enumerate(splits)]
    fitted = Normalizer.fit([m.features for m in motions], HUMANML3D_FEATURES.blocks)
    source = Source("synthetic", "CC0-1.0", "nobody")
    stored = stored_normalizer(fitted, "these clips")
    write_dataset(folder, motions, (source,), HUMANML3D_FEATURES, stored)
    return folder


def motion(generator: np.random.Generator, number: int, split: Split) -> StoredMotion:
    features = HUMANML3D_FEATURES.encode(joints_of(generator, int(generator.integers(25, 61))))
    frames = len(features)
    clip = StoredClip(
        id=f"{number:03d}",
        source="synthetic",
        origin="",
        split=split,
        frames=frames,
        shard=0,
        offset=0,
        captions=((f"a person sways left {number % 3}", 0, frames, ""),),
        mirrored_captions=((f"a person sways right {number % 3}", 0, frames, ""),),
        action=f"swayLeft{number % 3}",
        mirrored_action=f"swayRight{number % 3}",
    )
    return StoredMotion(clip, features)
