"""FBX through the user's Blender, which converts `.glb` to `.fbx` and back in the background.

Blender has the only free FBX reader and writer that work with most programs' files. It is looked
for in the environment variable, the PATH, the system's usual folders, and as `bpy` in this Python.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from latentmotion.errors import FileFormatError, InputError, MissingProgramError
from latentmotion.formats import gltf, gltf_reader
from latentmotion.formats.takes import SkeletonTake
from latentmotion.motion import Motion
from latentmotion.storage import files, limits, reading

# Environment variable that names Blender's program, or a Python that has `bpy`.
VARIABLE = "LATENTMOTION_BLENDER"

_SCRIPT = Path(__file__).with_name("blender_fbx.py")
_DONE = "latentmotion: converted"
_MOST_SECONDS = 600

# Meters by which bones miss the next joint. Blender's importers of FBX connect bones that meet, by
# 0.1 mm or less, and connected bones keep one length in all takes, whatever the file says.
_MISS = 3e-4

_PLACES = reading.packaged_toml(__file__, "blender.toml")  # Usual paths of Blender, by system.


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes one figure with one take per motion.

    Raises:
        InputError: The motions differ in skeleton, the folder cannot be written, or Blender fails.
        MissingProgramError: There is no Blender; the message says how to name one.
    """

    def write_glb(glb: Path) -> None:
        gltf.write(glb, motions, _MISS)

    return convert(write_glb, Path(path), motions[0].fps)


def convert(write_glb: Callable[[Path], object], target: Path, fps: float) -> list[Path]:
    """Writes an FBX file from a `.glb` that is written for it.

    Args:
        write_glb: Writes the `.glb` to a path.
        target: The FBX file.
        fps: Frames per second of its scene.

    Raises:
        InputError: The folder cannot be written, or Blender fails.
        MissingProgramError: There is no Blender.
    """
    blender = find_blender()
    files.check_writable(target)
    with _folder_for(blender, target) as folder, files.atomic_file(target) as temporary:
        write_glb(folder / "figure.glb")
        problem = _run(blender, [str(folder / "figure.glb"), str(temporary), repr(fps)], temporary)
        if problem:
            raise InputError(f"{blender} could not write FBX {problem}")
    return [target]


@contextmanager
def as_glb(path: str | Path) -> Iterator[Path]:
    """Converts an FBX file to a `.glb` in a temporary folder, which is removed at the block's end.

    Errors of the `.glb` become errors of the FBX file.

    Raises:
        FileFormatError: It is no FBX, is too large, or Blender cannot read it.
        MissingProgramError: There is no Blender; the message says how to name one.
    """
    source, blender = Path(path), find_blender()
    if b"FBX" not in reading.read_bytes(source, limits.MOST_TEXT)[:4096]:
        raise FileFormatError(source, "is no FBX file: its head does not say so")
    with _folder_for(blender, source) as folder:
        glb = folder / f"{source.stem}.glb"
        problem = _run(blender, [str(source.absolute()), str(glb)], glb)
        if problem:
            raise FileFormatError(source, f"{blender} could not read it {problem}")
        try:
            yield glb
        except FileFormatError as error:
            message = str(error).removeprefix(f"{glb}: ")
            raise FileFormatError(source, f"{message} (as Blender converted it)") from error


def read_takes(path: str | Path) -> list[SkeletonTake]:
    """Reads all animations.

    Raises:
        FileFormatError: The file is damaged, or Blender cannot read it.
        MissingProgramError: There is no Blender.
    """
    with as_glb(path) as glb:
        return gltf_reader.read_takes(glb)


@contextmanager
def _folder_for(blender: Path, beside: Path) -> Iterator[Path]:
    """Makes a temporary folder that a Blender sees: one in a sandbox sees none of the system's."""
    boxed = any(word in str(blender) for word in ("snap", "flatpak"))
    parent = beside.absolute().parent if boxed else None
    with tempfile.TemporaryDirectory(prefix=".latentmotion-", dir=parent) as folder:
        yield Path(folder)


def _run(blender: Path, arguments: Sequence[str], output_file: Path) -> str | None:
    """Runs the script; returns what went wrong, if anything did."""
    words = [*command(blender), "--", *arguments]
    # Python's variables lead to this Python's packages, not to Blender's.
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    try:
        run = subprocess.run(
            words, env=clean, capture_output=True, timeout=_MOST_SECONDS, check=False
        )
    except OSError as error:
        return f"(it does not start: {error.strerror or error})"
    except subprocess.TimeoutExpired:
        return f"(it took longer than {_MOST_SECONDS} s and was stopped)"
    output = (run.stdout + run.stderr).decode("utf-8", "replace")
    if _DONE not in output or not output_file.is_file():
        lines = [line for line in output.splitlines() if line.strip(" ^~")]
        return f"(exit code {run.returncode}): {' / '.join(lines[-3:]) or 'it said nothing':.600}"
    return None


def check_ready(ending: str = ".fbx") -> None:
    """Raises MissingProgramError where there is no Blender; called before work begins."""
    find_blender()


def find_blender() -> Path:
    """Returns Blender's program, or a Python that has `bpy`.

    Raises:
        MissingProgramError: There is none, or the variable names something else.
    """
    named = os.environ.get(VARIABLE)
    if named:
        program = shutil.which(named)
        if program is None:
            raise MissingProgramError(f"{VARIABLE} is {named!r}, which is no program that can run")
        return Path(program)
    on_path = shutil.which("blender")
    if on_path is not None:
        return Path(on_path)
    patterns = _PLACES.get(sys.platform, _PLACES["linux"])
    for pattern in map(Path, patterns):
        pattern = pattern.expanduser()
        paths = Path(pattern.anchor).glob(str(pattern.relative_to(pattern.anchor)))
        programs = [path for path in paths if os.access(path, os.X_OK)]
        if programs:
            return max(programs)
    if importlib.util.find_spec("bpy") is not None:
        return Path(sys.executable)
    looked = ", ".join(patterns)
    raise MissingProgramError(
        f".fbx needs Blender, which was not found: not in {VARIABLE} (not set), nor as 'blender' "
        f"in the PATH, nor in {looked}. Install it from https://www.blender.org, or set "
        f"{VARIABLE} to its program or to a Python that has bpy (pip install bpy); or use .glb, "
        "which most programs read and write"
    )


def command(blender: Path) -> list[str]:
    """Returns how the script is started by a Blender, or by a Python that has `bpy`."""
    if blender.stem.lower().startswith("python"):
        return [str(blender), str(_SCRIPT)]
    quiet = ["--background", "--factory-startup", "--python-exit-code", "1"]
    return [str(blender), *quiet, "--python", str(_SCRIPT)]
