"""`latentmotion blender-addon -o latentmotion-blender.zip`: the add-on for Blender as one file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.blender.build import build_zip, own_command
from latentmotion.cli import options
from latentmotion.errors import InputError


@dataclass(frozen=True)
class BlenderAddon:
    """Write the add-on for Blender 4.2 and later.

    Then, in Blender: Edit > Preferences > Add-ons > Install from Disk, and choose the zip.
    """

    output: options.Output = Path("latentmotion-blender.zip")
    """Zip file to write."""
    remember: bool = True
    """Store the path of this command in the zip, so that the add-on finds it; turn it off for a
    zip that you pass on."""

    def run(self) -> None:
        """Writes the zip.

        Raises:
            InputError: The ending is not .zip, or the folder cannot be written.
        """
        if self.output.suffix.lower() != ".zip":
            raise InputError(f"cannot write {self.output}: Blender installs .zip files alone")
        build_zip(self.output, own_command() if self.remember else None)
        print(f"wrote {self.output}")
        print("in Blender: Edit > Preferences > Add-ons > Install from Disk, choose this file")
