"""BVH files hold one take on any skeleton: several motions become several numbered files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from latentmotion.formats.bvh import read_bvh, write_bvh
from latentmotion.joint_map import to_humanml3d
from latentmotion.motion import Motion


def write_bvh_files(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes one BVH file for each motion: `out.bvh`, or `out-1.bvh`, `out-2.bvh` and so on.

    Raises:
        InputError: The folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    animations = [motion.animation() for motion in motions]
    for target, animation in zip(paths, animations, strict=True):
        write_bvh(target, animation)
    return paths


def read_bvh_file(path: str | Path) -> list[Motion]:
    """Reads a BVH file as a motion of HumanML3D's 22 joints.

    Raises:
        FileFormatError: The file is damaged.
        InputError: No joint map fits the skeleton.
    """
    animation = read_bvh(path)
    return [Motion(to_humanml3d(animation), fps=animation.fps)]


def numbered(path: Path, count: int) -> list[Path]:
    """Returns the names of `count` files: the path itself, or `-1`, `-2` before its ending."""
    if count == 1:
        return [path]
    return [path.with_stem(f"{path.stem}-{i}") for i in range(1, count + 1)]
