"""Data sets as their owners distribute them, one file per source."""

import tomllib
from pathlib import Path

from latentmotion.data.clip import Source

_FOLDER = Path(__file__).parent

# What words, numbers and names of classes say, in sentences, by source.
LABELS = tomllib.loads((_FOLDER / "labels.toml").read_text(encoding="utf-8"))

# Whom the motions of each source belong to, and on which terms.
OWNERS = {
    name: Source(name, **row)
    for name, row in tomllib.loads((_FOLDER / "owners.toml").read_text(encoding="utf-8")).items()
}
