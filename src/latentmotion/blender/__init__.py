"""The add-on for Blender, as a zip: an extension for 4.2 and later, and an add-on for earlier ones.

What is packed runs inside Blender and imports nothing else of this package.
"""

from __future__ import annotations

import shutil
import sys
import zipfile
from pathlib import Path

from latentmotion.storage.files import atomic_file

SOURCE = Path(__file__).parent / "latentmotion_blender"  # The folder that is packed.

# File in the zip that holds the path of the command that made it: the add-on tries it first.
COMMAND = "command.txt"

_EPOCH = (1980, 1, 1, 0, 0, 0)
_ENDINGS = (".py", ".toml")


def build_zip(path: str | Path, command: str | None = None) -> Path:
    """Writes the zip; the same add-on makes the same bytes.

    Args:
        path: The file to write.
        command: The `latentmotion` command to remember; by default the add-on looks for it.

    Raises:
        InputError: The folder does not exist or cannot be written.
    """
    texts = {
        file.name: file.read_text(encoding="utf-8")
        for file in SOURCE.iterdir()
        if file.suffix in _ENDINGS
    }
    if command is not None:
        texts[COMMAND] = command + "\n"
    with atomic_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, text in sorted(texts.items()):
            entry = zipfile.ZipInfo(f"{SOURCE.name}/{name}", _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)
    return Path(path)


def own_command() -> str | None:
    """Returns the path of the `latentmotion` command of this Python, if there is one."""
    return shutil.which("latentmotion", path=str(Path(sys.executable).parent))
