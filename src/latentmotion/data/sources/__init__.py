"""Data sets as their owners distribute them, one file per source."""

from latentmotion.data.clip import Source
from latentmotion.storage.reading import packaged_toml

# What words, numbers and names of classes say, in sentences, by source.
LABELS = packaged_toml(__file__, "labels.toml")

# Whom the motions of each source belong to, and on which terms.
OWNERS = {name: Source(name, **row) for name, row in packaged_toml(__file__, "owners.toml").items()}
