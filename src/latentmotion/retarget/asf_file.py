"""ASF as a rig: Acclaim's skeleton, whose motions are written as BVH of the same names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from latentmotion.formats.asf import read_asf
from latentmotion.formats.asf_amc import figure_skeleton
from latentmotion.formats.bvh import write_bvh
from latentmotion.formats.takes import numbered
from latentmotion.retarget.rig_files import Take


class AsfFile:
    """An ASF file.

    Args:
        path: The file.

    Raises:
        FileFormatError: It is damaged.
    """

    declared: Mapping[str, int] = {}
    endings = (".bvh",)
    movable = frozenset({0})

    def __init__(self, path: Path) -> None:
        figure = read_asf(path)
        self.path, self.unit = path, 1.0
        self.skeleton = figure_skeleton(path.stem, figure)
        self.root = figure.meters * np.asarray(figure.position)

    def write(self, path: Path, takes: Sequence[Take]) -> list[Path]:
        """Writes one BVH file for each take, in centimeters."""
        paths = numbered(path, len(takes))
        for target, take in zip(paths, takes, strict=True):
            write_bvh(target, take.animation)
        return paths
