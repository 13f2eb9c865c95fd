"""`latentmotion experiment`: the paper's tables beside ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion.cli import options
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.errors import named
from latentmotion.reproduce.table import TABLES, rows_named

if TYPE_CHECKING:
    from latentmotion.reproduce.runner import TableRunner


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
        from latentmotion.reproduce.markdown import overview, rows_of

        name = self.name
        print(rows_of(named("experiment", name, TABLES)) if name else overview(TABLES.values()))


@dataclass(frozen=True)
class JoinRuns:
    """Join runs of a table that differ in seed or evaluator: means of trainings, with intervals.

    Writes OUTPUT/TABLE.md, .json and .svg; for a second evaluator OUTPUT/TABLE_2.md and so on.

    Example: latentmotion experiment join quality --results seed_0 seed_1 seed_2 -o joined
    """

    name: Annotated[Positional[str], arg(metavar="TABLE")]
    """Table; `latentmotion experiment list` names them."""
    results: tuple[Path, ...]
    """Output folders of `latentmotion experiment run`, with another denoiser_training.seed or
    --evaluator each."""
    output: options.Output
    """Folder to write."""

    def run(self) -> None:
        """Joins; prints the page of the first evaluator.

        Raises:
            InputError: The table is unknown, a folder has none, or the runs do not fit together.
        """
        from latentmotion.reproduce.runner import join_runs

        page = join_runs(named("experiment", self.name, TABLES), self.results, self.output)
        print(page.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class RunExperiment:
    """Train and measure the rows of a table; the same command again resumes a stopped run.

    Tables that share a folder share models. Writes OUTPUT/NAME.md, .json and, for a figure, .svg.

    Example: latentmotion experiment run vae --data my_data --budget small -o results
    """

    name: Annotated[Positional[str], arg(metavar="TABLE")]
    """Table to run; `latentmotion experiment list` names them."""
    data: options.Data
    output: options.Output
    """Folder of models and results."""
    budget: Literal["paper", "small"] = "paper"
    """paper for the paper's sizes, small for two cores."""
    set: options.Changes = ()
    """Change one setting of every model, e.g. denoiser_training.steps=1000; repeatable."""
    rows: tuple[str, ...] = ()
    """Rows to run; by default all."""
    evaluator: options.Evaluator = None
    text_encoder: options.TextEncoderName = options.TEXT_ENCODER
    protocol: options.ProtocolChoice | None = None
    """Rules of the evaluation; by default paper with the budget paper, else clean."""
    body: Path | None = None
    """SMPL model file (SMPL_NEUTRAL.npz) for the loss on vertices of action models; without it they
    compare joints."""
    vaes: Path | None = None
    """Folder of trained VAEs, the output of another run; by default they are trained, too."""
    replications: int | None = None
    """Repetitions of each measurement; by default those of the budget."""
    device: options.Device = options.AUTO

    def run(self) -> None:
        """Trains, measures and writes; prints the page.

        Raises:
            InputError: Table, row or budget is unknown, or the folder holds other runs.
        """
        rows = rows_named(named("experiment", self.name, TABLES), self.rows)
        with self.opened() as runner:
            print(runner.run(rows).read_text(encoding="utf-8"))

    @contextmanager
    def opened(self) -> Iterator[TableRunner]:
        """Yields the table's runner, with its device, data and models.

        Raises:
            InputError: Table or budget is unknown.
        """
        from latentmotion.data.dataset import Dataset
        from latentmotion.engine.encoder import CachedTextEncoder
        from latentmotion.evaluation.evaluators.interface import load_evaluator
        from latentmotion.evaluation.protocol import PROTOCOLS
        from latentmotion.networks.backend import text_encoder_named
        from latentmotion.reproduce import budget, runner, workspace
        from latentmotion.training.distributed import distributed_context

        @cache
        def encoder(name: str) -> TextEncoder:
            folder = self.output / "text" / name.replace(":", "_").replace("/", "_")
            return CachedTextEncoder(text_encoder_named(name), folder)

        table = named("experiment", self.name, TABLES)
        with distributed_context(self.device) as context:
            budgeted = named("budget", self.budget, budget.BUDGETS)
            sizes = budgeted.of_table(self.name).changed(self.set)
            data = Dataset.load(self.data)
            work = workspace.Workspace(
                *(data, self.output, sizes, context, encoder, self.text_encoder),
                vaes=self.vaes,
                body=self.body,
            )
            evaluator = load_evaluator(self.evaluator) if self.evaluator else None
            count = self.replications or sizes.replications
            name = self.protocol or ("paper" if self.budget == "paper" else "clean")
            protocol = sizes.protocol(replace(PROTOCOLS[name], replications=count))
            yield runner.TableRunner(table, work, protocol, evaluator)
