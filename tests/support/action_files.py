"""Files of action data in exactly the layout that ACTOR distributes, of made-up people."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from latentmotion.kinematics.rotations import axis_angle_from_matrix
from latentmotion.representation.smpl import SMPL_FEATURES
from tests.support.walker import walker

START = np.array([0.1, 0.2, 3.0])  # Where they stand in front of the camera, meters.


def poses(frames: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vectors (frames, 24, 3) and joints (frames, 24, 3), in the camera's axes."""
    body = SMPL_FEATURES.retarget(walker(frames + 1).joints())
    rotations, _ = SMPL_FEATURES.pose(SMPL_FEATURES.encode(body).astype(np.float64))
    vectors = axis_angle_from_matrix(rotations)
    vectors[:, 15] += 0.1 * np.random.default_rng(seed).normal(size=3)
    way = np.cumsum(np.random.default_rng(seed).normal(0, 0.02, (frames, 3)), axis=0)
    joints = SMPL_FEATURES.skeleton.forward_kinematics(rotations, START + way)
    return vectors, joints


def write_humanact12(
    path: Path, frames: Sequence[int] = (80, 40, 61, 70), actions: Sequence[int] = (1, 1, 11, 0)
) -> Path:
    """`humanact12poses.pkl`."""
    made = [poses(count, seed) for seed, count in enumerate(frames)]
    content = {
        "poses": [vectors.reshape(-1, 72) for vectors, _ in made],
        "oldposes": [],
        "joints3D": [joints for _, joints in made],
        "y": list(actions),
    }
    path.write_bytes(pickle.dumps(content))
    return path


VIDEOS = (
    "a0_d0_p001_c1_color.avi",  # train
    "a1_d2_p002_c2_color.avi",  # train, seen from the side
    "a39_d8_p003_c2_color.avi",  # circled by the camera
    "a39_d3_p003_c1_color.avi",  # test, short
    "a2_d1_p006_c1_color.avi",  # train, too short
)


def write_uestc(folder: Path, shifts: bool = False) -> Path:
    """UESTC's folder of five videos, by the names above; the second is the first, turned."""
    (folder / "info").mkdir(parents=True)
    made = [poses(count, seed) for seed, count in enumerate((70, 70, 50, 30, 44))]
    vectors = [pose.reshape(-1, 72).astype(np.float32) for pose, _ in made]
    joints = [np.zeros((len(j), 49, 3), np.float32) for _, j in made]
    for whole, (_, body) in zip(joints, made, strict=True):
        whole[:, 8] = body[:, 0] - body[:1, 0]
    random = np.random.default_rng(0)
    cameras = [random.uniform(0.4, 0.6, (len(v), 4)).astype(np.float32) for v in vectors]
    content = {"pose": vectors, "joints3d": joints, "orig_cam": cameras, "betas": []}
    (folder / "vibe_cache_refined.pkl").write_bytes(pickle.dumps(content))
    if shifts:
        known = [np.full((len(v), 3), 0.0) for v in vectors]
        (folder / "globtrans_usez.pkl").write_bytes(pickle.dumps(known))
    names = "".join(f"{name}\n" for name in VIDEOS)
    (folder / "info/names.txt").write_text(names)
    (folder / "info/num_frames_min.txt").write_text("70\n65\n50\n30\n44\n")
    actions = [f"action-{number}" for number in range(39)] + ["left-kicking"]
    (folder / "info/action_classes.txt").write_text("\n".join(actions) + "\n")
    return folder
