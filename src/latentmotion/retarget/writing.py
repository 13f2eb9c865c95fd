"""Writing: motions go into the rig's own file, or as BVH beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.formats.bvh import write_bvh
from latentmotion.formats.takes import numbered
from latentmotion.motion import Motion
from latentmotion.retarget.rig import Rig
from latentmotion.retarget.rig_files import Take
from latentmotion.retarget.transfer import retarget


def write(
    path: str | Path,
    rig: Rig,
    motions: Sequence[Motion],
    fps: float | None = None,
    names: Sequence[str] | None = None,
) -> list[Path]:
    """Carries motions to a rig and writes it.

    Args:
        path: `.glb` or `.gltf`: the rig's file with the animations added; those of the same name
            are replaced. `.bvh`: its skeleton, one file for each motion.
        rig: The rig.
        motions: At least one.
        fps: Frames per second of the animations; by default each motion's own.
        names: What the animations are called; by default by the captions.

    Returns:
        The files written.

    Raises:
        InputError: The ending does not fit the rig, or the folder cannot be written.
    """
    target = Path(path)
    check_output(rig, target)
    if not motions:
        raise InputError(f"no motion to write to {target}, expected at least one")
    motions = motions if fps is None else [motion.resampled(fps) for motion in motions]
    names = names or [motion.caption or f"take {n}" for n, motion in enumerate(motions, 1)]
    animations = [retarget(motion, rig) for motion in motions]
    if target.suffix.lower() in rig.file.endings:
        takes = [Take(n, rig.in_file(a)) for n, a in zip(names, animations, strict=True)]
        return rig.file.write(target, takes)
    paths = numbered(target, len(animations))
    for place, animation in zip(paths, animations, strict=True):
        write_bvh(place, animation)
    return paths


def check_output(rig: Rig, path: Path) -> None:
    """Checks early that a rig can be written with such an ending.

    Raises:
        InputError: It cannot.
    """
    endings = dict.fromkeys((*rig.file.endings, ".bvh"))
    if path.suffix.lower() not in endings:
        raise InputError(
            f"{rig.file.path} cannot be written as {path.suffix or 'a file without ending'}; "
            f"expected {' or '.join(endings)}"
        )
