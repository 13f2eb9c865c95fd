"""`latentmotion export`: a trained model becomes a folder that runs without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.model_card import read_card
from latentmotion.runtime.package import package_model


@dataclass(frozen=True)
class Export:
    """Make a trained model run without PyTorch.

    Example: latentmotion export runs/denoiser/model --text-encoder runs/text -o my_model
    """

    model: Positional[Path]
    """Folder that training wrote."""
    text_encoder: Path
    """Folder that `latentmotion train text-encoder` wrote."""
    output: Annotated[Path, arg(aliases=["-o"])]
    """Folder to write."""
    name: str | None = None
    """What the model shall be called; by default as the folder."""
    license: str | None = None
    """License of the weights; by default the terms of all data sets."""

    def run(self) -> None:
        """Writes the folder and says how large it is.

        Raises:
            ModelError: Something is missing, or a graph does not repeat its network.
        """
        card = replace(read_card(self.model), name=self.name or self.output.resolve().name)
        if self.license:
            card = replace(card, provenance=replace(card.provenance, license=self.license))
        package_model(self.model, card, self.text_encoder, self.output)
        size = sum(file.stat().st_size for file in self.output.iterdir()) / 1e6
        print(f"wrote {self.output} ({size:.1f} MB)")
