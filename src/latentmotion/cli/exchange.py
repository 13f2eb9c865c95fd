"""`latentmotion exchange`: a model gets the decoder of another one with the same latents."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


@dataclass(frozen=True)
class Exchange:
    """Gives a model the decoder of another one with the same encoder, which is checked.

    Example: latentmotion exchange runs/student --decoder runs/decoder -o my_model
    """

    model: Positional[str]
    """Name, run folder or model folder."""
    decoder: str
    """Name, run folder or model folder of the model whose decoder is taken."""
    output: Annotated[Path, arg(aliases=["-o"])]
    """Folder to write, for evaluation, or to be made ready by `latentmotion export`."""

    def run(self) -> None:
        """Writes the folder."""
        from latentmotion.checkpoint import load_stages, save_model
        from latentmotion.exchange import with_decoder
        from latentmotion.model.folder import find_model

        model, other = (load_stages(find_model(name)) for name in (self.model, self.decoder))
        save_model(self.output, with_decoder(model, other))
        print(self.output)
