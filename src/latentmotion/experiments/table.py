"""What a table of the paper is here: rows, each a model, how it is sampled, and what is printed.

The paper's figures stand beside ours. One that could not be found in a source stays empty; where
each comes from is said in `published.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from latentmotion.diffusion.sampler import SamplerName

Kind = Literal["real", "reconstructed", "generated", "prior", "latents"]
"""What a row looks at: the data, a VAE's copies of it, samples of the diffusion or of a VAE's
prior, or latents along the reverse process."""

Base = Literal["mld", "mdm", "mdm_50", "starter", "fast"]
"""What a model is changed from: the paper's, diffusion on raw frames and its fast form, ours as it
ships (which is taken as it is), or our preset for HumanML3D."""


@dataclass(frozen=True)
class Model:
    """A trained model that rows, of one table or several, share."""

    name: str
    """Folder of its runs."""
    base: Base = "mld"
    """Where the changes start from."""
    changes: tuple[str, ...] = ()
    """`part.key=value`, in the paper's sizes."""
    task: Literal["text", "action", "unconditional"] = "text"
    """What it is conditioned on."""
    first: str = ""
    """Model whose first stage it builds on; empty for its own."""
    encoder: str = ""
    """Text encoder that this model is about; empty for the one that the command names."""

    @property
    def raw(self) -> bool:
        """Whether its diffusion is on raw frames, so that it has no first stage."""
        return self.base in ("mdm", "mdm_50")


@dataclass(frozen=True)
class Row:
    """A line of a table."""

    name: str
    """What `--rows` calls it."""
    title: str
    """What the table prints."""
    kind: Kind = "generated"
    """What is measured."""
    model: str = ""
    """Name of its model; empty for real motions, and for a row that cannot be run here."""
    steps: int | None = None
    """Sampling steps; the model's own where empty."""
    guidance: float | None = None
    """Guidance scale; the model's own where empty."""
    sampler: SamplerName | None = None
    """Sampler; the model's own where empty."""
    paper: Mapping[str, float] = field(default_factory=dict)
    """The paper's figures by metric."""
    missing: str = ""
    """Why it is not run here, where it is not."""


@dataclass(frozen=True)
class Table:
    """One table or figure."""

    name: str
    """What the command line calls it."""
    title: str
    """What it shows."""
    where: str
    """Where the paper has it."""
    rows: tuple[Row, ...]
    """Its lines."""
    metrics: tuple[str, ...]
    """Its columns."""
    data: str = "any text-motion data set"
    """What it is run on."""
    figure: Literal["", "time", "guidance", "training", "tsne"] = ""
    """Plot that goes with it."""
    expects: str = ""
    """What the paper concludes from it."""
