"""`latentmotion evaluate`: the figures of a model's card, measured on a prepared data set."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.checkpoint import load_model
from latentmotion.data.clip import SPLITS
from latentmotion.data.dataset import Dataset
from latentmotion.errors import ModelError
from latentmotion.evaluation.card import generated_figures, real_figures, reconstruction
from latentmotion.generator import MotionGenerator
from latentmotion.models import find_model


@dataclass(frozen=True)
class Evaluate:
    """Measure a model and write the figures into its model.json.

    Example: latentmotion evaluate my_model --data my_data
    """

    model: Positional[str]
    """Name or folder of a model that `latentmotion export` wrote."""
    data: Annotated[Path, arg(aliases=["-d"])]
    """Folder that `latentmotion data prepare` wrote."""
    split: str = "test"
    """Split whose captions are asked for."""

    def run(self) -> None:
        """Prints a table and writes the figures.

        Raises:
            ModelError: The model has no VAE of its own.
        """
        folder = find_model(self.model)
        dataset, trained = Dataset.load(self.data), load_model(folder)
        if trained.vae is None:
            raise ModelError(f"{folder} has no VAE to measure")
        splits = [name for name in SPLITS if any(c.captions for c in dataset.clips(name))]
        errors = {name: reconstruction(trained.vae, dataset, name) for name in splits}
        print(" ".join(f"{split} {error:.1f}" for split, error in errors.items()), "mm MPJPE")
        rows = {
            "generated": generated_figures(MotionGenerator.load(folder), dataset, self.split),
            "real": real_figures(dataset, self.split),
        }
        figures = {name: asdict(row) for name, row in rows.items()}
        _print(figures)
        figures["reconstruction_mpjpe_mm"] = errors
        replace(trained.card, figures={**trained.card.figures, **figures}).write(folder)


def _print(figures: dict[str, dict[str, float]]) -> None:
    names = list(figures["real"])
    print(f"| | {' | '.join(names)} |\n{'|---' * (len(names) + 1)}|")
    for row, values in figures.items():
        print(f"| {row} | {' | '.join(f'{values[name]:.4g}' for name in names)} |")
