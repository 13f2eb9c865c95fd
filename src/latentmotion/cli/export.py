"""`latentmotion export|swap-decoder`: trained models become folders to use and to share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from latentmotion.checkpoint import load_stages, save_model
from latentmotion.cli.options import Model, OptionalTextEncoder, Output
from latentmotion.cli.train import text_encoder_named
from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.text.lengths import LENGTHS_FILE, LengthModel
from latentmotion.condition.text.pretrained import KINDS, PretrainedTextEncoder
from latentmotion.condition.text.pretrained_export import export_pretrained
from latentmotion.errors import InputError
from latentmotion.exchange import with_decoder
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

    model: Model
    output: Output
    """Model folder to write."""
    text_encoder: OptionalTextEncoder = None
    length: Path | None = None
    """Length predictor that `latentmotion train length` wrote, for a model that reads sentences; by
    default the one beside the text encoder, if any."""
    precision: GraphPrecision = "float32"
    """Precision of matrix products in the graphs; int8 is faster and slightly less exact
    (docs/guide/runtime.md)."""
    name: str | None = None
    """Name of the model; by default that of the folder."""
    license: str | None = None
    """License of the weights; by default the terms of all data sets."""
    share_encoder: bool = False
    """Leave out the VAE's encoder, which only training and evaluation need, if a shipped model has
    the same one; saves some 4 MB."""

    def run(self) -> None:
        """Writes the folder and prints its size.

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


@dataclass(frozen=True)
class SwapDecoder:
    """Give a model the decoder of another model with the same encoder, which is checked.

    Example: latentmotion swap-decoder runs/student --decoder runs/decoder -o my_model
    """

    model: Model
    decoder: str
    """Name, run folder or model folder of the model whose decoder is taken."""
    output: Output
    """Model folder to write, for evaluation or for `latentmotion export`."""

    def run(self) -> None:
        """Writes the folder."""
        model, other = (load_stages(find_model(name)) for name in (self.model, self.decoder))
        save_model(self.output, with_decoder(model, other))
        print(self.output)


def _write_texts(encoder: WriteTextEncoder, lengths: LengthModel, folder: Path) -> None:
    encoder(folder)
    lengths.write(folder / LENGTHS_FILE)


def _export(encoder: TextEncoder, folder: Path) -> None:
    if not isinstance(encoder, PretrainedTextEncoder):
        raise InputError(f"the text encoder {encoder.name} cannot be exported")
    export_pretrained(encoder, folder)
