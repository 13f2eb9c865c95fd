"""NumPy's `.npz`: joint positions of one or more takes, for Python programs; nothing pickled.

    joints   (all frames, joints, 3) float32, meters, y up; takes one after the other
    frames   (takes,) number of frames of each take
    fps      (takes,)
    caption  (takes,) text
    metadata (takes,) JSON
    names (joints,), parents (joints,), offsets (joints, 3), skeleton: the skeleton

One take is read back by `numpy.load(path)["joints"]`, several by
`numpy.split(joints, numpy.cumsum(frames)[:-1])`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from latentmotion.errors import FileFormatError, InputError, LatentMotionError
from latentmotion.formats.takes import SkeletonTake, parse_notes
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from latentmotion.motion import Motion
from latentmotion.storage import array_files, reading

_KEYS = frozenset(
    {"joints", "frames", "fps", "caption", "metadata", "skeleton", "names", "parents", "offsets"}
)
_KNOWN = {len(skeleton): skeleton for skeleton in (HUMANML3D, KIT)}


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes motions of one skeleton.

    Raises:
        InputError: The motions differ in skeleton, or the folder cannot be written.
    """
    skeleton = motions[0].skeleton
    if any(motion.skeleton.names != skeleton.names for motion in motions):
        raise InputError("the takes of one .npz file must share a skeleton; write several files")
    arrays = {
        "joints": np.concatenate([motion.joints for motion in motions]),
        "frames": np.array([len(motion) for motion in motions]),
        "fps": np.array([motion.fps for motion in motions], dtype=np.float64),
        "caption": np.array([motion.caption for motion in motions], dtype=np.str_),
        "metadata": np.array([json.dumps(dict(m.metadata)) for m in motions], dtype=np.str_),
        "skeleton": np.array(skeleton.name),
        "names": np.array(skeleton.names),
        "parents": np.array(skeleton.parents),
        "offsets": np.asarray(skeleton.offsets),
    }
    array_files.write_arrays(path, arrays)
    return [Path(path)]


def read(path: str | Path) -> list[SkeletonTake] | list[Motion]:
    """Reads the takes that `write` wrote, or SMPL pose parameters, recognized by their keys.

    Raises:
        FileFormatError: The file is damaged, or holds something else.
    """
    from latentmotion.formats import smpl

    names = array_files.names_in(path)
    if "results" in names:  # ROMP's
        return smpl.read(path)
    if smpl.is_smpl(names):
        return [smpl.read_arrays(path, array_files.read_arrays(path, smpl.KEYS))]
    return read_motions(path)


def read_motions(path: str | Path) -> list[Motion]:
    """Reads the takes that `write` wrote.

    Raises:
        FileFormatError: The file is damaged, or holds something else.
    """
    arrays = array_files.read_arrays(path, _KEYS)
    try:
        with reading.blamed_on(path):
            names = tuple(str(name) for name in arrays["names"])
            skeleton = next((ours for ours in _KNOWN.values() if ours.names == names), None)
            if skeleton is None:
                parents = tuple(int(parent) for parent in arrays["parents"])
                skeleton = Skeleton(str(arrays["skeleton"]), names, parents, arrays["offsets"])
            joints, frames = arrays["joints"], arrays["frames"]
            is_count = frames.dtype.kind in "iu" and (frames > 0).all()
            if not is_count or frames.sum() != len(joints):
                raise FileFormatError(path, f"its takes do not add up to the {len(joints)} frames")
            takes = np.split(joints, np.cumsum(frames)[:-1])
            facts = zip(takes, arrays["fps"], arrays["caption"], arrays["metadata"], strict=True)
            return [
                Motion(take, float(fps), skeleton, str(caption), parse_notes(path, metadata))
                for take, fps, caption, metadata in facts
            ]
    except KeyError as error:
        sizes = " or ".join(map(str, _KNOWN))
        lack = f"not a motion file of Latent Motion: it lacks {error}"
        raise FileFormatError(
            path, f"{lack}; bare joints (frames, {sizes}, 3) go in .npy"
        ) from error
    except (ValueError, TypeError) as error:
        raise FileFormatError(path, f"not a motion file of Latent Motion ({error})") from error


def read_joints(path: str | Path) -> list[SkeletonTake] | list[Motion]:
    """Reads a bare `.npy` array of joints (frames, joints, 3), as HumanML3D and KIT publish them.

    An array of objects is what TRAM writes, one of 322 numbers a frame is Motion-X's.

    Raises:
        FileFormatError: The file is damaged, or holds something else.
    """
    from latentmotion.formats import smpl

    if array_files.holds_objects(path):
        return smpl.read(path)
    joints = array_files.read_array(path)
    if joints.shape[1:] == (smpl.MOTIONX_NUMBERS,) and joints.dtype.kind in "fiu":
        return [smpl.motionx_take(path, joints)]
    try:
        skeleton = _KNOWN[joints.shape[1]]
        # Bare joints do not say their rate: these are the data sets' own.
        return [Motion(joints, fps=12.5 if skeleton is KIT else 20.0, skeleton=skeleton)]
    except (ValueError, KeyError, IndexError, LatentMotionError) as error:
        expected = f"expected an array (frames, {' or '.join(map(str, _KNOWN))}, 3)"
        problem = f"{expected} of joint positions, or Motion-X's (frames, 322) ({error})"
        raise FileFormatError(path, problem) from error
