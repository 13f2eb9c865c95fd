"""Takes: numbered files for formats of one take, and motions from animations of any program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from latentmotion.errors import FileFormatError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.formats.bvh import read_bvh, write_bvh
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Animation
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.storage.reading import blamed_on, parse_json

OURS = {skeleton.names: skeleton for skeleton in (HUMANML3D, KIT, BODY)}
"""Our own skeletons by the names of their joints."""

_LAYOUTS = (".amass", ".smplx", ".smpl")
"""Parts of a name before the ending that belong to the ending."""


def write_bvh_files(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes one BVH file for each motion: `out.bvh`, or `out-1.bvh`, `out-2.bvh` and so on.

    Raises:
        InputError: The folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    animations = [motion.animation() for motion in counted(motions, "finding rotations")]
    for target, animation in zip(paths, animations, strict=True):
        write_bvh(target, animation)
    return paths


def read_bvh_file(path: str | Path) -> list[Motion]:
    """Reads a BVH file as a motion; see `motion_of`.

    Raises:
        FileFormatError: The file is damaged.
        DataError: No joint map fits the skeleton.
    """
    with blamed_on(path):
        motion = motion_of(read_bvh(path))
    return [motion]


def read_amc_file(path: str | Path) -> list[Motion]:
    """Reads an AMC file, with the ASF beside it, as a motion of 120 frames per second.

    Raises:
        FileFormatError: A file is damaged, or there is no skeleton.
        DataError: No joint map fits the skeleton.
    """
    with blamed_on(path):
        motion = motion_of(read_asf_amc(path))
    return [motion]


def motion_of(
    animation: Animation,
    notes: Mapping[str, Any] | None = None,
    declared: Mapping[str, int] | None = None,
) -> Motion:
    """Returns an animation as a motion of our own skeleton of those names, else of HumanML3D's.

    Args:
        animation: The animation in the file.
        notes: The file's `caption` and other metadata.
        declared: VRM's names of its joints, where the file itself has them.

    Raises:
        DataError: The names of the skeleton's joints are unknown.
    """
    notes = current_notes(notes or {})
    metadata = {key: value for key, value in notes.items() if key not in ("caption", "fps")}
    caption = str(notes.get("caption", ""))
    tips = animation.skeleton.end_sites
    names = tuple(n for j, n in enumerate(animation.skeleton.names) if j not in tips)
    known = OURS.get(names)
    if known is None:
        joints, known = to_humanml3d(animation, declared=declared), HUMANML3D
    else:
        joints = animation.joints()[:, [j for j in range(len(animation.skeleton)) if j not in tips]]
    return Motion(joints, animation.fps, known, caption, metadata)


def parse_notes(path: str | Path, text: Any) -> dict[str, Any]:
    """Returns the metadata that a file keeps as JSON.

    Raises:
        FileFormatError: It is no JSON, or no object.
    """
    notes = parse_json(str(text), path)
    if not isinstance(notes, dict):
        raise FileFormatError(
            path, f"its metadata are a {type(notes).__name__}, expected an object"
        )
    return current_notes(notes)


def current_notes(notes: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a file's metadata in today's names.

    Earlier files call the license of the model's weights `license`, as if it were that of the
    motion.
    """
    old = "license" in notes and "model" in notes and "weights_license" not in notes
    return {"weights_license" if old and key == "license" else key: notes[key] for key in notes}


def numbered(path: Path, count: int) -> list[Path]:
    """Returns the names of `count` files: the path itself, or `-1`, `-2` before its ending."""
    if count == 1:
        return [path]
    stem, layout = path.stem, Path(path.stem).suffix
    if layout.lower() in _LAYOUTS:
        stem = path.stem.removesuffix(layout)
    ending = path.name.removeprefix(stem)
    return [path.with_name(f"{stem}-{number}{ending}") for number in range(1, count + 1)]
