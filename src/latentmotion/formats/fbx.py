"""FBX through the user's Blender: writes a `.glb` and has Blender convert it in the background.

Blender has the only free FBX writer whose files other programs accept. It is looked for in the
environment variable, the PATH, the system's usual folders, and as `bpy` in this Python.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from latentmotion.errors import InputError, MissingProgramError
from latentmotion.formats import gltf
from latentmotion.motion import Motion
from latentmotion.storage.files import atomic_file, check_writable

VARIABLE = "LATENTMOTION_BLENDER"
"""Environment variable that names Blender's program, or a Python that has `bpy`."""

_SCRIPT = Path(__file__).with_name("blender_to_fbx.py")
_DONE = "latentmotion: fbx written"
_MOST_SECONDS = 600

_MISS = 3e-4
"""Meters by which bones miss the next joint. Blender's importers of FBX connect bones that meet, by
0.1 mm or less, and connected bones keep one length in all takes, whatever the file says."""

_PLACES: Mapping[str, tuple[str, ...]] = {
    "win32": (
        r"C:\Program Files\Blender Foundation\Blender *\blender.exe",
        r"C:\Program Files (x86)\Steam\steamapps\common\Blender\blender.exe",
    ),
    "darwin": (
        "/Applications/Blender*.app/Contents/MacOS/Blender",
        "~/Applications/Blender*.app/Contents/MacOS/Blender",
    ),
    "linux": (
        "/usr/local/bin/blender",
        "/snap/bin/blender",
        "/opt/blender*/blender",
        "~/blender*/blender",
        "~/Downloads/blender*/blender",
        "/var/lib/flatpak/exports/bin/org.blender.Blender",
        "~/.local/share/flatpak/exports/bin/org.blender.Blender",
        "~/.local/share/Steam/steamapps/common/Blender/blender",
    ),
}
"""Usual paths of Blender's program, by system; of several versions the last is taken."""


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes one figure with one take per motion.

    Raises:
        InputError: The motions differ in skeleton, the folder cannot be written, or Blender fails.
        MissingProgramError: There is no Blender; the message says how to name one.
    """
    blender, target = find_blender(), Path(path)
    check_writable(target)
    # Beside the target, since Blenders in a sandbox do not see the system's temporary folder.
    with (
        tempfile.TemporaryDirectory(
            prefix=".latentmotion-", dir=target.absolute().parent
        ) as folder,
        atomic_file(target) as temporary,
    ):
        source = gltf.write(Path(folder) / "figure.glb", motions, _MISS)[0]
        words = [*command(blender), "--", str(source), str(temporary), repr(motions[0].fps)]
        # Python's variables lead to this Python's packages, not to Blender's.
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        try:
            run = subprocess.run(
                words, env=clean, capture_output=True, timeout=_MOST_SECONDS, check=False
            )
        except OSError as error:
            raise InputError(f"{words[0]} does not start: {error.strerror or error}") from error
        except subprocess.TimeoutExpired as error:
            raise InputError(f"{words[0]} took longer than {_MOST_SECONDS} s; stopped") from error
        output = (run.stdout + run.stderr).decode("utf-8", "replace")
        if _DONE not in output or not temporary.is_file():
            lines = [line for line in output.splitlines() if line.strip()]
            last = " / ".join(lines[-3:]) or "nothing"
            raise InputError(f"{words[0]} could not write FBX (exit code {run.returncode}): {last}")
    return [target]


def check_ready() -> None:
    """Raises MissingProgramError where there is no Blender; called before motions are made."""
    find_blender()


def find_blender() -> Path:
    """Returns Blender's program, or a Python that has `bpy`.

    Raises:
        MissingProgramError: There is none, or the variable names something else.
    """
    named = os.environ.get(VARIABLE)
    if named:
        found = shutil.which(named)
        if found is None:
            raise MissingProgramError(f"{VARIABLE} is {named!r}, which is no program that can run")
        return Path(found)
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
        f"writing .fbx needs Blender, which was not found: not in {VARIABLE} (not set), nor as "
        f"'blender' in the PATH, nor in {looked}. Install it from https://www.blender.org, or set "
        f"{VARIABLE} to its program or to a Python that has bpy (pip install bpy); or write .glb, "
        "which most programs read"
    )


def command(blender: Path) -> list[str]:
    """Returns how the script is started by a Blender, or by a Python that has `bpy`."""
    if blender.stem.lower().startswith("python"):
        return [str(blender), str(_SCRIPT)]
    quiet = ["--background", "--factory-startup", "--python-exit-code", "1"]
    return [str(blender), *quiet, "--python", str(_SCRIPT)]
