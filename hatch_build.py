"""Build hook: the README of the package, whose links lead to the repository.

On a package index a link such as `docs/guide/install.md` would lead nowhere.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

REPOSITORY = "https://github.com/latentmotion/latentmotion/blob/main/"
PICTURES = "https://raw.githubusercontent.com/latentmotion/latentmotion/main/"


def absolute(text: str) -> str:
    """Returns Markdown whose links and pictures do not depend on where it is shown."""
    text = re.sub(r"(!\[[^\]]*\]\()(?!\w+:)", rf"\g<1>{PICTURES}", text)
    return re.sub(r"((?<!!)\[[^\]]*\]\()(?!\w+:|#)", rf"\g<1>{REPOSITORY}", text)


class Readme(MetadataHookInterface):
    """Gives the metadata the README."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Adds the field `readme`."""
        text = absolute(Path(self.root, "README.md").read_text(encoding="utf-8"))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
