"""USD reader: the animations of a file, read by a process of its own with limits.

USD's library crashes on some damaged files and takes gigabytes for others. `usd_figure` runs as a
program with bounded memory and time, and hands its result over as arrays.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path

from latentmotion import errors
from latentmotion.formats.takes import SkeletonTake
from latentmotion.kinematics.skeleton import Animation, Skeleton
from latentmotion.storage import array_files, children, limits, reading

_PROGRAM = "latentmotion.formats.usd_figure"
# Exit codes: the file is damaged, or the result cannot be written; a line on standard output says
# why.
REFUSED, UNWRITTEN = 3, 4


def read_takes(path: str | Path) -> list[SkeletonTake]:
    """Reads all animations that move the skeleton with the most joints; its rest if there is none.

    Files that `usd.write` wrote have captions.

    Raises:
        FileFormatError: The file is damaged, or has no skeleton.
    """
    path, arrays, takes = Path(path), {}, []
    if find_spec("pxr") is None:
        raise errors.MissingExtraError("USD", "usd-core", "usd")
    try:
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "animations.npz"
            done = subprocess.run(
                children.command(_PROGRAM, str(path.absolute()), str(target)),
                env=children.environment(),
                capture_output=True,
                timeout=2 * limits.USD_SECONDS,
                check=False,
            )
            if not done.returncode:
                arrays = array_files.read_arrays(target, lambda name: True)
    except subprocess.TimeoutExpired as error:
        raise errors.FileFormatError(
            path, f"not read in {2 * limits.USD_SECONDS} s; damaged?"
        ) from error
    except OSError as error:
        raise _no_room(path, error.strerror or str(error)) from error
    last = _last_line(path, done.stderr)
    if done.returncode == REFUSED:
        raise errors.FileFormatError(path, _last_line(path, done.stdout))
    if done.returncode == UNWRITTEN:
        raise _no_room(path, _last_line(path, done.stdout))
    if done.returncode < 0:  # a signal
        problem = f"USD's library ended with {done.returncode} ({last})"
        raise errors.FileFormatError(path, f"{problem}; the file is damaged, or too large")
    if done.returncode:
        raise errors.InputError(
            f"{path}: not read, as the program that reads USD does not work here ({last}); this "
            "says nothing of the file: check `ulimit -v`, or run pip install "
            '"latentmotion[usd]" again'
        )
    names, parents = tuple(map(str, arrays["names"])), tuple(arrays["parents"].tolist())
    skeleton = Skeleton(path.stem, names, parents, arrays["offsets"])
    for number in range(int(arrays["takes"])):
        root, fps = arrays[f"root_{number}"], float(arrays[f"fps_{number}"])
        moves = arrays.get(f"translations_{number}")
        animation = Animation(skeleton, arrays[f"rotations_{number}"], root, fps, moves)
        try:
            notes = reading.parse_json(str(arrays[f"notes_{number}"]), path)
        except errors.LatentMotionError:  # another program's
            notes = {}
        takes.append(SkeletonTake(animation, notes if isinstance(notes, dict) else {}))
    return takes


def _last_line(path: Path, output: bytes) -> str:
    """Returns the last line of output without the folder, which may be the server's."""
    lines = output.decode(errors="replace").strip().splitlines()
    line = (lines or ["it said nothing"])[-1]
    return f"{line.replace(f'{path.absolute().parent}{os.sep}', ''):.300}"


def _no_room(path: Path, problem: str) -> errors.DiskFullError:
    return errors.DiskFullError(
        f"{path}: not read, as a temporary file cannot be written ({problem}); make room in "
        "TMPDIR, or let it name another folder"
    )
