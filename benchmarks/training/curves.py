"""Learning curves: the VAEs of a table, trained in turn, by steps and by hours of processor time.

    python -m benchmarks.training.curves 1 vae --data DATA --budget small --rows mld_1 -o FOLDER

The words after the hours are those of `latentmotion experiment run`.

    FOLDER/MODEL/vae          run folder, as `latentmotion train vae` writes it
    FOLDER/TABLE_curves.json  the curves, and the error on every held-out clip at their end
    FOLDER/TABLE_curves.md    a page of them, with TABLE_curves.svg

The row that has had the least processor time goes on by a slice, so rows compare at any moment. The
learning rate is constant after its warm-up, as in the paper: no step depends on how many follow.
Errors are of the split `val`; the split `test` is not read.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch

from latentmotion.cli.experiment import RunExperiment
from latentmotion.cli.usage import parsed
from latentmotion.errors import InputError
from latentmotion.evaluation.candidates import MAX_BATCH_SIZE, Reconstructed
from latentmotion.evaluation.cost import parameters
from latentmotion.evaluation.metrics import mpjpe
from latentmotion.evaluation.report import Figure, table_line
from latentmotion.networks.checkpoint import build, load_stages
from latentmotion.reproduce.markdown import cell, number
from latentmotion.reproduce.plots import new_figure, save_figure
from latentmotion.reproduce.table import Row, Table, rows_named
from latentmotion.reproduce.workspace import Workspace
from latentmotion.storage.configuration import write_json
from latentmotion.storage.files import atomic_file
from latentmotion.storage.provenance import command_line, commit
from latentmotion.training.experiment import Experiment
from latentmotion.training.loop import Progress, read_progress
from latentmotion.training.run_folder import MODEL, Run, open_run, read_journal
from latentmotion.training.stages import train_first_stage
from latentmotion.training.vae import FeatureCache, VAEStage

CURVES = "_curves"  # Suffix of the page of a table's curves.

REFERENCE = "mld_1"  # Row that the others are compared with, clip by clip.


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("hours", type=float, help="core hours of each row, earlier ones included")
    options, words = parser.parse_known_args()
    command = parsed(RunExperiment, "experiment run", words)
    with command.opened() as tables:
        rows = rows_named(tables.table, command.rows)
        page = CurveRunner(tables.table, rows, tables.work).run(options.hours)
        print(page.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Point:
    """A validation."""

    step: int  # Optimizer steps.
    hours: float  # Processor time until then, at the run's mean pace.
    held_out_mm: float  # MPJPE of at most 64 held-out clips.
    training_mm: float  # MPJPE of at most 64 training clips.


@dataclass(frozen=True)
class Curve:
    """The curve of a row."""

    row: str  # Name in the table.
    title: str  # Title in the table.
    parameters: int  # Weights of the VAE.
    step: int  # Steps of the last snapshot.
    hours: float  # Processor time until then.
    points: tuple[Point, ...]  # Validations in order.
    # Kullback-Leibler divergence of the last training batch reported, nats a latent number.
    kl: float | None = None
    paper_mm: float | None = None  # The paper's figure on its own data.
    # MPJPE of each held-out clip at the end, where it was measured.
    errors_mm: tuple[float, ...] = ()


@dataclass(frozen=True)
class Curves:
    """The curves of a table."""

    table: str  # Its name.
    data: str  # Folder name and fingerprint of the data set.
    budget: str  # Changes of the budget.
    command: str  # The command that trained them last.
    commit: str  # Commit of the code.
    rows: tuple[Curve, ...]  # The curves, in the table's order.


@dataclass(frozen=True)
class CurveRunner:
    """Trains the VAEs of a table in turn and draws their curves."""

    table: Table  # The table.
    rows: Sequence[Row]  # Rows to train; those that rebuild nothing are left out.
    work: Workspace  # Data, models and sizes; a slice is `vae_training.validate_every` steps.

    def run(self, hours: float) -> Path:
        """Trains until each row has had so many hours of processor time; returns the page.

        Raises:
            InputError: No row is a VAE's, or a folder holds another run.
            DataError: The data cannot be used.
        """
        rows = [row for row in self.rows if row.motions == "reconstructed"]
        if not rows:
            raise InputError(
                f"no row of {self.table.name} rebuilds motions; vae is a table that has some"
            )
        while True:
            spent = {row.name: self.progress(row).processor_seconds / 3600 for row in rows}
            behind = min(rows, key=lambda row: spent[row.name])
            if spent[behind.name] >= hours:
                return self.write(rows, measured=True)
            self.train(behind)
            self.write(rows)

    def progress(self, row: Row) -> Progress:
        """Returns how far a row is."""
        return read_progress(self._folder(row))

    def experiment(self, row: Row, steps: int) -> Experiment:
        """Returns the experiment of a row, so many steps long."""
        model = self.work.models[row.model]
        features = self.work.dataset.representation.width
        experiment = model.first_stage(self.work.budget, features)
        settings = experiment.vae_training
        return replace(
            experiment,
            vae_training=replace(
                settings,
                steps=steps,
                schedule="constant",
                snapshot_every=settings.validate_every,
                sample_every=0,
            ),
        )

    def train(self, row: Row) -> None:
        """Trains a row for a slice."""
        work, folder = self.work, self._folder(row)
        done = self.progress(row).step
        slice_steps = self.experiment(row, 1).vae_training.validate_every
        experiment = self.experiment(row, done + slice_steps)
        work.tell(f"{folder}: steps {done} to {done + slice_steps}")
        open_run(folder, Run("vae", work.dataset.fingerprint, {}, experiment), work.context)
        torch.manual_seed(experiment.vae_training.seed)
        network = build(experiment.vae)
        stage = VAEStage(network, work.dataset, experiment, work.context, memory=self._memory)
        train_first_stage(stage, experiment, work.dataset, folder, work.context)

    @cached_property
    def _memory(self) -> FeatureCache:
        """Features of the clips, which all rows share: reading them takes as long as a slice."""
        data = self.work.dataset
        mirrored = self.experiment(self.table.rows[-1], 1).mirrored
        clips = [*data.clips("train", mirrored=mirrored), *data.clips("val")]
        return FeatureCache(data, clips, data.normalizer)

    def write(self, rows: Sequence[Row], measured: bool = False) -> Path:
        """Writes curves, page and figure.

        Args:
            rows: The rows.
            measured: Whether the error on every held-out clip is measured too.
        """
        work = self.work
        started = [row for row in rows if self.progress(row).step]
        curves = Curves(
            table=self.table.name,
            data=f"{work.dataset.folder.name} ({work.dataset.fingerprint[:12]})",
            budget=work.budget.says,
            command=command_line(),
            commit=commit(),
            rows=tuple(self._curve(row, measured) for row in started),
        )
        path = work.folder / f"{self.table.name}{CURVES}.json"
        write_json(path, curves)
        error_curves(
            path.with_suffix(".svg"),
            {
                curve.title: [
                    (point.step, point.hours, point.held_out_mm) for point in curve.points
                ]
                for curve in curves.rows
            },
        )
        page = path.with_suffix(".md")
        with atomic_file(page) as temporary:
            temporary.write_text(markdown(self.table, curves), encoding="utf-8")
        return page

    def _folder(self, row: Row) -> Path:
        return self.work.folder / row.model / "vae"

    def _curve(self, row: Row, measured: bool) -> Curve:
        progress, folder = self.progress(row), self._folder(row)
        pace = progress.processor_seconds / 3600 / progress.step
        lines = [line for line in read_journal(folder) if line["step"] <= progress.step]
        points = [
            Point(line["step"], line["step"] * pace, line["val_mm"], line["train_mm"])
            for line in lines
            if line["kind"] == "validation"
        ]
        return Curve(
            row=row.name,
            title=row.title,
            parameters=parameters(build(self.experiment(row, 1).vae)),
            step=progress.step,
            hours=progress.step * pace,
            points=tuple(points),
            kl=[None, *(line["kl"] for line in lines if "kl" in line)][-1],
            paper_mm=row.paper.get("MPJPE"),
            errors_mm=self.errors(folder / MODEL) if measured else (),
        )

    def errors(self, model: Path) -> tuple[float, ...]:
        """Returns the MPJPE of every held-out clip, mm; the parts of clips are the validation's."""
        stages, data = load_stages(model), self.work.dataset
        rebuilder = Reconstructed(stages.vae, stages.card)
        longest = stages.card.frames[1]
        real = [data.features(clip)[:longest] for clip in data.clips("val")]
        found = []
        for start in range(0, len(real), MAX_BATCH_SIZE):
            found += rebuilder.reconstruct(real[start : start + MAX_BATCH_SIZE])
        decode = data.representation.decode
        pairs = zip(found, real, strict=True)
        return tuple(round(mpjpe(decode(one), decode(other)), 2) for one, other in pairs)


def markdown(table: Table, curves: Curves) -> str:
    """Returns the page of curves: a line per row, with its difference from the paper's own VAE."""
    named = {curve.row: curve for curve in curves.rows}
    reference = named.get(REFERENCE, next(iter(curves.rows), None))
    headings = (
        "",
        "weights 10⁶",
        "steps",
        "core hours",
        "s a step",
        "MPJPE mm, 64 clips",
        "fall in the last quarter",
        "KL, nats a number",
        "all held-out clips",
        f"against {reference.title if reference else REFERENCE}",
        "paper",
    )
    lines = [table_line(list(headings)), table_line(["---"] * len(headings))]
    for curve in curves.rows:
        assert reference is not None
        differences: list[float] = []
        if curve is not reference and len(curve.errors_mm) == len(reference.errors_mm):
            pairs = zip(curve.errors_mm, reference.errors_mm, strict=True)
            differences = [one - other for one, other in pairs]
        lines.append(
            table_line(
                [
                    curve.title,
                    number(curve.parameters / 1e6),
                    f"{curve.step:,}",
                    number(curve.hours),
                    number(3600 * curve.hours / curve.step),
                    number(curve.points[-1].held_out_mm) if curve.points else "–",
                    last_fall(curve.points),
                    number(curve.kl) if curve.kl else "–",
                    over_clips(curve.errors_mm),
                    over_clips(differences),
                    f"{curve.paper_mm:g}" if curve.paper_mm else "",
                ]
            )
        )
    title = f"{table.title}: error of held-out clips by training"
    return "\n".join(
        [
            f"### {title}",
            "",
            *lines,
            "",
            f"<details><summary>Trained on {curves.data}.</summary>",
            "",
            f"* Budget: {curves.budget}; but as many steps as above, at a constant rate after "
            "warm-up.",
            "* Intervals are 95 %, over clips; differences are paired by clip. One run a row.",
            f"* `{curves.command}`" + (f", commit {curves.commit}." if curves.commit else "."),
            "",
            "</details>",
            "",
            f"![{title}]({table.name}{CURVES}.svg)",
            "",
        ]
    )


def over_clips(values: Sequence[float]) -> str:
    """Returns the mean and half of its 95 % interval as a cell; – of none."""
    figure = Figure.of(values) if values else None
    return cell((figure.mean, figure.interval) if figure else (None, None))


def last_fall(points: Sequence[Point]) -> str:
    """Returns how far the error fell over the last quarter of the hours, as a share; – of few."""
    before = [point for point in points if point.hours <= 0.75 * points[-1].hours]
    if not before:
        return "–"
    return f"{1 - points[-1].held_out_mm / before[-1].held_out_mm:.1%}"


def error_curves(path: Path, curves: Mapping[str, Sequence[tuple[int, float, float]]]) -> None:
    """Draws the joint error of held-out clips by optimizer step and by processor time.

    Args:
        path: SVG to write.
        curves: For each run its (step, hours, mm).
    """
    figure, panels = new_figure(columns=2)
    for panel, column, label in ((panels[0], 0, "Optimizer step"), (panels[1], 1, "Core hours")):
        for name, points in curves.items():
            panel.plot([p[column] for p in points], [p[2] for p in points], ".-", label=name)
        panel.set(xlabel=label, ylabel="MPJPE of held-out clips, mm")
        panel.grid(alpha=0.3)
    if curves:
        panels[0].legend(fontsize=8)
    save_figure(figure, path)


if __name__ == "__main__":
    main()
