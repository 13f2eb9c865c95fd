"""Folders of synthetic motion in exactly the layouts that the sources have on disk."""

from __future__ import annotations

import json
import lzma
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from latentmotion.data.recording import every
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.representation.humanml3d import HumanML3DRepresentation

CMU_ROWS = [
    ("05_18", 0, 40, "000001"),
    ("05_18", 20, 60, "000002"),
    ("06_01", 0, 50, "000003"),
    ("07_01", 0, 90, "000004"),
    ("99_01", 0, 90, "000005"),
]
CMU_SPLITS = {"000001": "train", "000002": "train", "000003": "test", "000004": "train"}
CMU_TEXTS = {
    "000001": "he waves left.#he/PRON#0.0#0.0\nhe stops.#he/PRON#1.0#1.5\n",
    "M000001": "he waves right.#he/PRON#0.0#0.0\n",
}
# What `write_annotations` writes of the trials 05_18, 06_01 and 07_01.
CMU_FILES = CMU_ROWS, CMU_SPLITS, CMU_TEXTS


def swaying(frames: int, fps: float = 120.0, seed: int = 0) -> Animation:
    """A figure that walks forward while every joint sways."""
    generator = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None] / fps
    frequency, phase = generator.uniform(0.3, 1.0, (2, 1, len(HUMANML3D), 3))
    angles = 0.2 * np.sin(2 * np.pi * (frequency * time + phase))
    root = np.zeros((frames, 3))
    root[:, 1], root[:, 2] = 0.95, time[:, 0, 0]
    return Animation(HUMANML3D, matrix_from_axis_angle(angles), root, fps)


def with_t_pose(animation: Animation) -> Animation:
    """The same with the rest pose as its first frame, as in the BVH conversions of CMU."""
    rotations = np.concatenate([np.eye(3)[None, None].repeat(22, 1), animation.rotations])
    root = np.concatenate([animation.root_positions[:1], animation.root_positions])
    return Animation(HUMANML3D, rotations, root, animation.fps)


def write_cmu_trials(folder: Path, trials: Mapping[str, Animation]) -> Path:
    for trial, animation in trials.items():
        (folder / trial[:2]).mkdir(parents=True, exist_ok=True)
        write_bvh(folder / trial[:2] / f"{trial}.bvh", with_t_pose(animation))
    return folder


def write_annotations(
    folder: Path,
    rows: Sequence[tuple[str, int, int, str]],
    splits: Mapping[str, str],
    texts: Mapping[str, str],
    archive: bool = False,
) -> Path:
    """HumanML3D's folder: rows are trial, start, end, id; splits and texts go by id."""
    folder.mkdir(parents=True)
    lines = [
        f"./pose_data/CMU/{trial[:2]}/{trial}_poses.npy,{start},{end},{name}.npy"
        for trial, start, end, name in rows
    ]
    header = "source_path,start_frame,end_frame,new_name"
    (folder / "index.csv").write_text("\n".join([header, *lines]) + "\n")
    write_splits(folder, splits)
    if archive:
        with lzma.open(folder / "texts.json.xz", "wt") as file:
            json.dump(dict(texts), file)
    else:
        write_texts(folder, texts)
    return folder


def write_splits(folder: Path, splits: Mapping[str, str]) -> None:
    for split in ("train", "val", "test"):
        names = [name for name, found in splits.items() if found == split]
        (folder / f"{split}.txt").write_text("".join(f"{name}\n" for name in names))


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    (folder / "texts").mkdir()
    for name, text in texts.items():
        (folder / "texts" / f"{name}.txt").write_text(text)


def write_official(folder: Path, representation: HumanML3DRepresentation) -> Path:
    """An official processed folder of three clips and a mirrored copy of the first."""
    (folder / "new_joint_vecs").mkdir(parents=True)
    generator = np.random.default_rng(0)
    for name in ("000000", "000001", "000002", "M000000"):
        features = generator.normal(size=(40, representation.width)).astype(np.float32)
        np.save(folder / "new_joint_vecs" / f"{name}.npy", features)
    write_splits(folder, {"000000": "train", "M000000": "train", "000001": "val", "000002": "test"})
    whole, part = "he waves left.#he/PRON wave/VERB left/ADV#0.0#0.0", "he stops.#he/PRON#1.0#1.5"
    texts = dict.fromkeys(("000000", "000001", "000002"), f"{whole}\n{part}\n")
    write_texts(folder, texts | {"M000000": "he waves to the right.#he/PRON#0.0#0.0\n"})
    np.save(folder / "Mean.npy", np.full(representation.width, 0.5))
    np.save(folder / "Std.npy", np.full(representation.width, 2.0))
    return folder


def write_own(folder: Path, names: Sequence[str], fps: float = 60.0) -> Path:
    for seed, name in enumerate(names):
        path = folder / f"{name}.bvh"
        path.parent.mkdir(parents=True, exist_ok=True)
        animation = swaying(150, fps, seed)
        write_bvh(path, every(animation, 1))
    return folder
