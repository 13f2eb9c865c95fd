"""Data sets as their owners distribute them, one file per source."""

import tomllib
from pathlib import Path

# What words, numbers and names of classes say, in sentences, by source.
LABELS = tomllib.loads(Path(__file__).with_name("labels.toml").read_text(encoding="utf-8"))
