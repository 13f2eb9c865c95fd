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
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from latentmotion.errors import FileFormatError, InputError, LatentMotionError
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from latentmotion.motion import Motion
from latentmotion.storage.files import atomic_file

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
    with atomic_file(path) as temporary:
        np.savez_compressed(temporary, **arrays)
    return [Path(path)]


def read(path: str | Path) -> list[Motion]:
    """Reads the takes that `write` wrote, or SMPL pose parameters, recognized by their keys.

    Raises:
        FileFormatError: The file is damaged, or holds something else.
    """
    from latentmotion.formats import smpl_npz

    try:
        with Path(path).open("rb") as opened:
            if not zipfile.is_zipfile(opened):
                raise FileFormatError(path, "not a motion file: cut short, or no .npz at all")
            opened.seek(0)
            file = np.load(opened, allow_pickle=False)
            if smpl_npz.is_smpl(file.files):
                return [smpl_npz.read_arrays(path, file)]
            arrays = {name: file[name] for name in file.files}
        names = tuple(str(name) for name in arrays["names"])
        skeleton = next((known for known in _KNOWN.values() if known.names == names), None)
        if skeleton is None:
            parents = tuple(int(parent) for parent in arrays["parents"])
            skeleton = Skeleton(str(arrays["skeleton"]), names, parents, arrays["offsets"])
        takes = np.split(arrays["joints"], np.cumsum(arrays["frames"])[:-1])
        facts = zip(arrays["fps"], arrays["caption"], arrays["metadata"], strict=True)
        return [
            Motion(joints, float(fps), skeleton, str(caption), json.loads(str(metadata)))
            for joints, (fps, caption, metadata) in zip(takes, facts, strict=True)
        ]
    except FileFormatError:
        raise
    except KeyError as error:
        known = " or ".join(map(str, _KNOWN))
        lack = f"not a motion file of Latent Motion: it lacks {error}"
        raise FileFormatError(
            path, f"{lack}; bare joints (frames, {known}, 3) go in .npy"
        ) from error
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise FileFormatError(path, f"not a motion file of Latent Motion ({error})") from error
    except LatentMotionError as error:
        raise FileFormatError(path, str(error)) from error


def read_joints(path: str | Path) -> list[Motion]:
    """Reads a bare `.npy` array of joints (frames, joints, 3), as HumanML3D and KIT publish them.

    Raises:
        FileFormatError: The file is damaged, or holds something else.
    """
    try:
        with Path(path).open("rb") as opened:
            joints = np.load(opened, allow_pickle=False)
        skeleton = _KNOWN[joints.shape[1]]
        return [Motion(joints, fps=12.5 if skeleton is KIT else 20.0, skeleton=skeleton)]
    except (ValueError, KeyError, IndexError, OSError, EOFError, LatentMotionError) as error:
        expected = f"expected an array (frames, {' or '.join(map(str, _KNOWN))}, 3)"
        raise FileFormatError(path, f"{expected} of joint positions ({error})") from error
