"""`latentmotion export|swap-decoder`: trained models become folders to use and to share."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.cli import options
from latentmotion.data.dataset import Dataset
from latentmotion.engine.lengths import LengthModel
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.text_motion import export_scorer, load_text_motion
from latentmotion.export import package
from latentmotion.export.onnx import Weights
from latentmotion.export.web import export_web
from latentmotion.model import card as cards
from latentmotion.networks.backend import find_encoder, text_encoder_named
from latentmotion.networks.checkpoint import load_stages, save_model
from latentmotion.networks.pretrained_text import KINDS, PretrainedTextEncoder


@dataclass(frozen=True)
class Export:
    """Make a trained model run without PyTorch.

    Example: latentmotion export runs/denoiser/model --text-encoder runs/text -o my_model
    """

    model: options.Model
    output: options.Output
    """Model folder to write."""
    text_encoder: options.OptionalTextEncoder = None
    length: Path | None = None
    """Length predictor that `latentmotion train length` wrote, for a model that reads sentences; by
    default the one beside the text encoder, if any."""
    precision: cards.GraphPrecision = "float32"
    """Precision of matrix products in the graphs; int8 is faster and slightly less exact
    (docs/guide/runtime.md)."""
    name: str | None = None
    """Name of the model; by default that of the folder."""
    license: str | None = None
    """License of the weights; by default the terms of all data sets."""
    share_encoder: bool = False
    """Leave out the VAE's encoder, which only training and evaluation need, if a shipped model has
    the same one; saves some 4 MB."""

    web: bool = False
    """Write a folder for web pages, of a few-step model of sentences (docs/guide/web.md)."""
    weights: Weights | None = None
    """Large matrices: int8 has a scale for each row, float16 is as exact as training. By default
    int8 for web pages (6 MB smaller), float16 otherwise; int8 there keeps the encoder and the
    decoder's last layer in 16 bits."""

    def run(self) -> None:
        """Writes the folder and prints its size.

        Raises:
            ModelError: Something is missing, or a graph does not repeat its network.
        """
        source = cards.find_model(self.model)
        if not self.web:
            self._package(source, self.output)
        elif any(source.glob("fused_*.onnx")):
            names = ("text_encoder", "length", "precision", "name", "license", "share_encoder")
            options.refuse_unused(self, f"{source} is exported already", *names)
            export_web(source, self.output, self.weights or "int8")
        else:
            with tempfile.TemporaryDirectory() as temporary:
                packaged = Path(temporary) / self.output.resolve().name
                self._package(source, packaged)
                export_web(packaged, self.output, self.weights or "int8")
        size = sum(file.stat().st_size for file in self.output.iterdir()) / 1e6
        print(f"wrote {self.output} ({size:.1f} MB)")

    def _package(self, source: Path, output: Path) -> None:
        name = self.name or output.resolve().name
        card = replace(cards.read_card(source), name=name, precision=self.precision)
        if self.license:
            card = replace(card, provenance=replace(card.provenance, license=self.license))
        reads, named = card.condition.reads_text, self.text_encoder
        parts: list[package.WriteTextEncoder] = []
        for option, value in {"text-encoder": named, "length": self.length}.items():
            if value and not reads:
                raise InputError(f"a model of task {card.task} reads no sentences; omit --{option}")
        folder = cards.text_encoder_folder(card, source) if reads and named is None else None
        if named is not None and named.partition(":")[0] not in KINDS:
            folder = cards.find_model(named)
        if folder is not None:
            parts.append(package.copied(folder))
        elif reads:
            encoder = text_encoder_named(named) if named else find_encoder(card, source)
            if not isinstance(encoder, PretrainedTextEncoder):
                raise InputError(f"the text encoder {encoder.name} cannot be exported")
            parts.append(partial(package.export_pretrained, encoder))
        if self.length is not None:
            lengths = LengthModel.read(self.length, card.condition.encoder)
            parts.append(lambda target: lengths.write(target / cards.LENGTHS_FILE))

        def write_text(target: Path) -> None:
            for write in parts:
                write(target)

        package.package_model(
            *(source, card, write_text if reads else None, output),
            *(self.share_encoder, self.weights or "float16"),
        )


@dataclass(frozen=True)
class SwapDecoder:
    """Give a model the decoder of another model with the same encoder, which is checked.

    Example: latentmotion swap-decoder runs/student --decoder runs/decoder -o my_model
    """

    model: options.Model
    decoder: str
    """Name, run folder or model folder of the model whose decoder is taken."""
    output: options.Output
    """Model folder to write, for evaluation or for `latentmotion export`."""

    def run(self) -> None:
        """Writes the folder."""
        model, other = (load_stages(cards.find_model(name)) for name in (self.model, self.decoder))
        save_model(self.output, package.with_decoder(model, other))
        print(self.output)


@dataclass(frozen=True)
class ExportScorer:
    """Make a scorer of an evaluator that was trained with --preset scorer; it runs without PyTorch.

    Example: latentmotion export scorer runs/scorer/model -o my_scorer
    """

    evaluator: Annotated[Positional[Path], arg(metavar="EVALUATOR")]
    """Folder of the evaluator."""
    output: options.Output
    """Scorer folder to write."""
    data: options.OptionalData = None
    """Prepared training data, whose recorded clips' vectors and names are added for `latentmotion
    nearest`."""
    name: str | None = None
    """Name of the scorer; by default the evaluator's."""

    def run(self) -> None:
        """Writes the folder and prints its size.

        Raises:
            DataError: The data have other features.
            ModelError: The evaluator is missing, or no such one.
        """
        evaluator = load_text_motion(self.evaluator)
        data = Dataset.load(self.data) if self.data else None
        export_scorer(evaluator, self.output, data, self.name)
        size = sum(file.stat().st_size for file in self.output.iterdir()) / 1e6
        print(f"wrote {self.output} ({size:.2f} MB)")
