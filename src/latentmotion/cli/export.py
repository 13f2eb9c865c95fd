"""`latentmotion export`: a trained model becomes a folder that runs without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.cli.train import text_encoder_named
from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.text.lengths import LENGTHS_FILE, LengthModel
from latentmotion.condition.text.pretrained import KINDS, PretrainedTextEncoder
from latentmotion.condition.text.pretrained_export import export_pretrained
from latentmotion.errors import InputError
from latentmotion.model.card import GraphPrecision, ModelCard, read_card
from latentmotion.model.folder import find_model
from latentmotion.runtime.conditions import encoder_folder
from latentmotion.runtime.eager import find_encoder
from latentmotion.runtime.package import WriteTextEncoder, copied, package_model


@dataclass(frozen=True)
class Export:
    """Make a trained model run without PyTorch.

    Example: latentmotion export runs/denoiser/model --text-encoder runs/text -o my_model
    """

    model: Annotated[Positional[Path], arg(metavar="MODEL")]
    """Folder that training or `latentmotion convert` wrote."""
    output: Annotated[Path, arg(aliases=["-o"])]
    """Folder to write."""
    text_encoder: str | None = None
    """For a model that reads sentences: folder that `latentmotion train text-encoder` wrote, name
    of a model whose encoder is taken, or clip:FOLDER, minilm:FOLDER and the like; by default the
    one in the model's folder, or that its card names where it is on this machine."""
    length: Path | None = None
    """For a model that reads sentences: file that `latentmotion train length` wrote; by default the
    one beside the text encoder, if any."""
    precision: GraphPrecision = "float32"
    """Of matrix products in the graphs; int8 is faster and a little less exact
    (docs/runtime.md)."""
    name: str | None = None
    """What the model shall be called; by default as the folder."""
    license: str | None = None
    """License of the weights; by default the terms of all data sets."""
    share_encoder: bool = False
    """Leave the VAE's encoder, which only training and evaluation need, to a shipped model that
    has the same: some 4 MB less."""

    def run(self) -> None:
        """Writes the folder and says how large it is.

        Raises:
            ModelError: Something is missing, or a graph does not repeat its network.
        """
        source = find_model(self.model)
        name = self.name or self.output.resolve().name
        card = replace(read_card(source), name=name, precision=self.precision)
        if self.license:
            card = replace(card, provenance=replace(card.provenance, license=self.license))
        package_model(source, card, self._texts(card, source), self.output, self.share_encoder)
        size = sum(file.stat().st_size for file in self.output.iterdir()) / 1e6
        print(f"wrote {self.output} ({size:.1f} MB)")

    def _texts(self, card: ModelCard, source: Path) -> WriteTextEncoder | None:
        encoder = self._text_encoder(card, source)
        if self.length is None:
            return encoder
        if encoder is None:
            raise InputError(f"a model of task {card.task} reads no sentences; omit --length")
        lengths = LengthModel.read(self.length, card.condition.text_encoder)
        return partial(_write_texts, encoder, lengths)

    def _text_encoder(self, card: ModelCard, source: Path) -> WriteTextEncoder | None:
        if not card.condition.reads_text and self.text_encoder:
            raise InputError(f"a model of task {card.task} reads no sentences; omit --text-encoder")
        if not card.condition.reads_text:
            return None
        if self.text_encoder is None:
            folder = encoder_folder(card, source)
            return copied(folder) if folder else partial(_export, find_encoder(card, source))
        if self.text_encoder.partition(":")[0] in KINDS:
            return partial(_export, text_encoder_named(self.text_encoder))
        return copied(find_model(self.text_encoder))


def _write_texts(encoder: WriteTextEncoder, lengths: LengthModel, folder: Path) -> None:
    encoder(folder)
    lengths.write(folder / LENGTHS_FILE)


def _export(encoder: TextEncoder, folder: Path) -> None:
    if not isinstance(encoder, PretrainedTextEncoder):
        raise InputError(f"the text encoder {encoder.name} cannot be exported")
    export_pretrained(encoder, folder)
