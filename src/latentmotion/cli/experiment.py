"""`latentmotion experiment list` and `run`: the paper's tables, our figures beside the paper's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion.cli.options import (
    AUTO,
    TEXT_ENCODER,
    Changes,
    Data,
    Device,
    Evaluator,
    Output,
    ProtocolChoice,
    TextEncoderName,
)
from latentmotion.experiments.tables import TABLES, rows_named, table_named

if TYPE_CHECKING:
    from latentmotion.condition.interface import TextEncoder
    from latentmotion.evaluation.extractors.interface import ActionExtractor, TextMotionExtractor
    from latentmotion.evaluation.settings import Protocol
    from latentmotion.experiments.workplace import Workplace
    from latentmotion.training.devices import Place


@dataclass(frozen=True)
class ListExperiments:
    """List the tables and figures of the paper that can be run, and what each needs.

    Example: latentmotion experiment list
    """

    name: Annotated[Positional[str], arg(metavar="TABLE")] = ""
    """Table to list the rows of."""

    def run(self) -> None:
        """Prints a table.

        Raises:
            InputError: There is none of this name.
        """
        from latentmotion.experiments.overview import overview, rows_of

        print(rows_of(table_named(self.name)) if self.name else overview(TABLES.values()))


@dataclass(frozen=True)
class FillDocument:
    """Insert finished tables into a document, between lines such as <!-- table vae -->.

    Example: latentmotion experiment document docs/measurements/results.md --results results
    """

    document: Annotated[Positional[Path], arg(metavar="DOCUMENT")]
    """Markdown document; plots and JSON go into a folder beside it."""
    results: Path
    """Output folder of `latentmotion experiment run`."""

    def run(self) -> None:
        """Rewrites the document.

        Raises:
            InputError: It has no part that names a table.
        """
        from latentmotion.experiments.document import fill

        print(f"{self.document}: {', '.join(fill(self.document, self.results)) or 'none run yet'}")


@dataclass(frozen=True)
class RunExperiment:
    """Train and measure the rows of a table; the same command again resumes a stopped run.

    Tables that share a folder share models. Writes OUTPUT/NAME.md, .json and, for a figure, .png.

    Example: latentmotion experiment run vae --data my_data --budget small -o results
    """

    name: Annotated[Positional[str], arg(metavar="TABLE")]
    """Table to run; `latentmotion experiment list` names them."""
    data: Data
    output: Output
    """Folder of models and results."""
    budget: Literal["paper", "small"] = "paper"
    """paper for the paper's sizes, small for two cores."""
    set: Changes = ()
    """Change one setting of every model, e.g. denoiser_training.steps=1000; repeatable."""
    rows: tuple[str, ...] = ()
    """Rows to run; by default all."""
    evaluator: Evaluator = None
    text_encoder: TextEncoderName = TEXT_ENCODER
    protocol: ProtocolChoice = "clean"
    replications: int | None = None
    """Repetitions of each measurement; by default those of the budget."""
    device: Device = AUTO

    def run(self) -> None:
        """Trains, measures and writes; prints the page.

        Raises:
            InputError: Experiment, row or budget is unknown, or the folder holds other runs.
        """
        from latentmotion.experiments.measuring import Measurement
        from latentmotion.experiments.run import run_table
        from latentmotion.training.devices import training_place

        table = table_named(self.name)
        rows = rows_named(table, self.rows)
        with training_place(self.device) as place:
            work = self._workplace(place)
            extractor = self._extractor()
            measurement = Measurement(table, work, self._protocol(work), extractor)
            print(run_table(measurement, rows).read_text(encoding="utf-8"))

    def _workplace(self, place: Place) -> Workplace:
        from latentmotion.data.dataset import Dataset
        from latentmotion.experiments.budget import budget_named
        from latentmotion.experiments.workplace import Workplace

        budget = budget_named(self.budget).of_table(self.name).changed(self.set)
        folder, dataset = self.output, Dataset.load(self.data)
        return Workplace(dataset, folder, budget, place, cache(self._encoder), self.text_encoder)

    def _encoder(self, name: str) -> TextEncoder:
        from latentmotion.cli.train import text_encoder_named
        from latentmotion.condition.text.cache import CachedTextEncoder

        folder = self.output / "text" / name.replace(":", "_").replace("/", "_")
        return CachedTextEncoder(text_encoder_named(name), folder)

    def _protocol(self, work: Workplace) -> Protocol:
        from latentmotion.evaluation.settings import PROTOCOLS

        count = self.replications or work.budget.replications
        return work.budget.protocol(replace(PROTOCOLS[self.protocol], replications=count))

    def _extractor(self) -> TextMotionExtractor | ActionExtractor | None:
        from latentmotion.evaluation.extractors.interface import load_extractor

        return load_extractor(self.evaluator) if self.evaluator else None
