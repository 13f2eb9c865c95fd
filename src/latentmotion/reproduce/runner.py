"""Table runner: trains and measures rows, and writes the page of a table.

For each row a model is trained or taken as it is, and its figures are kept until something that
determines them changes. After every row NAME.json, NAME.md and NAME.svg are written anew.

Joined runs of a table: the same rows trained with other seeds, or judged by other evaluators.

A row that was trained several times has the mean of its trainings and the 95 % interval of that
mean, by Student's t; one that was trained once keeps the interval of its replications. There is a
page for each evaluator, the first of which has the table's name.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sqrt
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from latentmotion.diffusion.condition import TextEncoder
from latentmotion.errors import DataError, InputError
from latentmotion.evaluation.candidates import Candidate, Generated, Prior, Reconstructed
from latentmotion.evaluation.cost import cost_of, longest_of
from latentmotion.evaluation.evaluate import build_test_set, evaluate
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.evaluation.protocol import Protocol
from latentmotion.evaluation.report import GROUND_TRUTH, Figure, Report
from latentmotion.model.card import read_card
from latentmotion.networks.backend import torch_pipeline, torch_prior
from latentmotion.networks.checkpoint import WEIGHTS_FILE, load_stages
from latentmotion.pipeline import MotionPipeline
from latentmotion.progress import counted
from latentmotion.reproduce.markdown import RowResult, TableResult, markdown
from latentmotion.reproduce.plots import draw_figure, draw_latents
from latentmotion.reproduce.table import Row, Table
from latentmotion.reproduce.workspace import Workspace, training_cost, vae_cost
from latentmotion.storage.configuration import read_json, to_json, write_json
from latentmotion.storage.files import sha256, write_file
from latentmotion.training.loop import read_progress
from latentmotion.training.run_folder import read_run
from latentmotion.training.stages import frames_as_first_stage

SLOW = 1000  # Sampling steps from which a row has fewer replications.

# Clock of each metric of a motion's time. Processor time is that of all threads: with one it is the
# time on a quiet machine.
TIMES = {"AITS": time.perf_counter, "Processor time": time.process_time}

# Metrics of an evaluator's embeddings.
BY_EVALUATOR = {
    *("R@1", "R@2", "R@3", "FID", "FID train", "FID test", "KID", "MM-Dist"),
    *("Diversity", "MultiModality", "Accuracy"),
}

TIMED = 3  # Motions of a row that are timed.

BATCH = 32  # Motions that are made together for the time of 2,048.


@dataclass(frozen=True)
class TableRunner:
    """Trains and measures the rows of a table."""

    table: Table  # The table.
    work: Workspace  # Data, models and sizes.
    protocol: Protocol  # Protocol of the evaluation.
    # Evaluator of FID and other metrics of embeddings; None for metrics of positions alone.
    evaluator: Evaluator | None

    def run(self, rows: Sequence[Row]) -> Path:
        """Trains and measures rows; returns the Markdown page, with the rows of earlier runs too.

        Raises:
            InputError: A folder holds another run.
            DataError: The data cannot be used for this table.
        """
        self.check()
        page = self.work.folder / f"{self.table.name}.md"
        # The real motions are measured with every other row, and by themselves only if alone.
        others = [row for row in rows if row.motions != "real"] or list(rows)
        for row in counted(others, "rows"):
            self.row(row)
            # After every row, so that an interrupted run leaves what it has measured.
            write_page(page, self.table, self.measured_rows(), self.work.budget.says)
        return page

    @property
    def splits(self) -> tuple[str, ...]:
        """Splits that are measured; the last is that of most metrics."""
        return self.table.splits or (self.protocol.split,)

    def check(self) -> None:
        """Compares the data with what the table needs, before anything is trained.

        Raises:
            InputError: Without an evaluator no column of the table can be measured.
            DataError: They are another data set, or a split has too few usable clips.
        """
        table, dataset = self.table, self.work.dataset
        sources = [source.name for source in dataset.sources]
        if table.source and sources != [table.source]:
            raise DataError(
                f"{table.name} is of {table.data}; {dataset.folder} holds {', '.join(sources)}"
            )
        if self.evaluator is None and BY_EVALUATOR.issuperset(table.metrics):
            raise InputError(
                f"every column of {table.name} ({', '.join(table.metrics)}) needs an evaluator; "
                "name one: --evaluator FOLDER, or --evaluator scorer for text"
            )
        tasks = {self.work.models[row.model].task for row in table.rows if row.model}
        for split in self.splits:
            clips = [
                clip
                for clip in dataset.clips(split)
                if ("text" not in tasks or clip.captions) and ("action" not in tasks or clip.action)
            ]
            if len(clips) < 2:
                needs = {"text": "captions", "action": "a label"}
                lacking = " and ".join(needs[task] for task in sorted(tasks) if task in needs)
                raise DataError(
                    f"{table.name} is measured on the split {split}: {dataset.folder} has "
                    f"{len(clips)} clips with {lacking or 'motion'} there, expected at least 2"
                )

    def row(self, row: Row) -> RowResult:
        """Trains the missing stages and measures a row, unless its figures are there."""
        folder, slow = self.trained(row), (row.steps or 0) >= SLOW
        replications = self.protocol.replications
        # MultiModality is measured only where it is printed.
        printed = "MultiModality" in self.table.metrics and not slow
        repeats = self.protocol.repeats
        protocol = replace(
            self.protocol,
            replications=min(replications, self.work.budget.slow) if slow else replications,
            repeats=replace(repeats, texts=repeats.texts if printed else 0),
            nearest_clip=False,
            split=self.splits[-1],
        )
        path = self.work.folder / self.table.name / f"{row.name}.json"
        # Everything that determines the figures of the row.
        inputs: dict[str, Any] = {
            "row": to_json(replace(row, title="", paper={})),
            "weights": sha256(folder / WEIGHTS_FILE) if folder else "",
            "data": self.work.dataset.fingerprint,
            "evaluator": self.evaluator.fingerprint if self.evaluator else "",
            "protocol": to_json(protocol),
            "metrics": list(self.table.metrics),
            "splits": list(self.splits),
        }
        text = json.dumps(inputs, sort_keys=True, default=str)
        key = hashlib.sha256(text.encode()).hexdigest()
        if path.is_file():
            earlier = read_json(RowResult, path)
            if (earlier.key, earlier.made) == (key, self.made):
                return earlier
        self.work.tell(f"{self.table.name}/{row.name}: measuring {folder}")
        # Latents are drawn along the reverse process, which needs no replications.
        if folder is not None and row.motions == "latents":
            figures = draw_latents(self.pipeline(row), self.work.folder / f"{self.table.name}.svg")
            about = {"made": self.made, **_weights_and_hours(folder)}
            result = RowResult(row.name, key, _plain(figures), replications=1, **about)
        else:
            result = self._measured(row, folder, protocol, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, result)
        return result

    def trained(self, row: Row) -> Path | None:
        """Trains the missing stages of a row; returns its model folder, None for real motions."""
        if row.motions == "real":
            return None
        if row.motions in ("reconstructed", "prior"):
            return self.work.first_stage(row.model)
        if row.share is not None and row.share < 1:
            return self.work.kept(row.model, row.share)
        return self.work.both_stages(row.model)

    @property
    def made(self) -> dict[str, str]:
        """Data, evaluator, protocol and budget, which all rows of a page share."""
        return {
            "data": self.work.dataset.fingerprint,
            "evaluator": self.evaluator.fingerprint if self.evaluator else "",
            "protocol": self.protocol.name,
            "budget": self.work.budget.says,
        }

    def pipeline(self, row: Row) -> MotionPipeline:
        """Returns the trained model of a row, ready to generate."""
        folder = self.trained(row)
        assert folder is not None, "real motions have no model"
        return torch_pipeline(folder, self._encoder(row))

    def measured_rows(self) -> TableResult:
        """Returns the rows that are measured so far, in the table's order."""
        table, work, protocol = self.table, self.work, self.protocol
        folder = work.folder / table.name
        paths = {row.name: folder / f"{row.name}.json" for row in table.rows}
        measured = {
            name: read_json(RowResult, path) for name, path in paths.items() if path.is_file()
        }
        measured = {name: row for name, row in measured.items() if row.made == self.made}
        real = next((row.name for row in table.rows if row.motions == "real"), None)
        first = next((row for name, row in measured.items() if name != real), None)
        if real and first:
            # The row of the real motions is the ground truth of the first other row.
            row = replace(first, row=real, figures=first.truth, weights="", warnings=())
            measured |= {real: row}
        evaluator = self.evaluator.fingerprint[:12] if self.evaluator else "none"
        return TableResult(
            table=table.name,
            budget=work.budget.name,
            data=f"{work.dataset.folder.name} ({work.dataset.fingerprint[:12]})",
            protocol=f"{protocol.name}, split {' and '.join(self.splits)}, "
            f"{protocol.replications} "
            f"repetitions, evaluator {evaluator}",
            rows=tuple(measured[row.name] for row in table.rows if row.name in measured),
        )

    def _encoder(self, row: Row) -> TextEncoder | None:
        model = self.work.models[row.model]
        return None if model.shipped else self.work.encoder_of(model)

    def _measured(self, row: Row, folder: Path | None, protocol: Protocol, key: str) -> RowResult:
        candidate = self._candidate(row, folder)
        report, figures, truth = self._evaluated(candidate, protocol)
        about = {
            "truth": _plain(truth),
            "items": report.items[candidate.row],
            "replications": protocol.replications,
            "versions": dict(report.provenance.versions),
            "notes": report.notes,
            "made": self.made,
        }
        if folder is None:
            return RowResult(row.name, key, _plain(truth), warnings=report.warnings, **about)
        if isinstance(candidate, Generated) and {*TIMES, "GFLOPs"} & set(self.table.metrics):
            figures |= self._cost(row, candidate, folder, protocol)
        model = self.work.models[row.model]
        if isinstance(candidate, Generated) and "Training" in self.table.metrics:
            figures |= {} if model.shipped else training_cost(*self.work.run_folders(row.model))
        if isinstance(candidate, Reconstructed) and "Decoding" in self.table.metrics:
            data = self.work.dataset.representation
            figures |= vae_cost(candidate.vae, data.width, data.fps)
        planned, measured = self.protocol.replications, report.protocol.replications
        of_models = self.work.budget.of_models
        changes = [of_models[name].says for name in (row.model, model.first) if name in of_models]
        warnings = list(report.warnings)
        if measured < planned:
            warnings.append(f"measured {measured} times instead of {planned}")
        if changes:
            warnings.append(f"trained with {', '.join(changes)}")
        if self.work.body is None and model.experiment().vae_objective.vertices:
            warnings.append(
                "stage 1 compares joints where the paper compares SMPL's vertices: no --body"
            )
        if model.equal:
            steps = read_run(folder.parent).experiment.denoiser_training.steps
            warnings.append(
                f"trained for {steps:,} steps, as many {model.equal} as both stages of MLD-1 of z₀"
            )
        vae = self.work.run_folders(row.model)[0] if self.work.vaes and not model.shipped else None
        if vae:
            training = read_run(vae).experiment.vae_training
            steps = read_progress(vae).step or training.steps
            recipe = f"{steps:,} steps of {training.batch_size}, {training.schedule} rate"
            warnings.append(f"its VAE was taken as it was: {recipe}")
        return RowResult(
            row=row.name,
            key=key,
            figures=_plain(figures),
            warnings=tuple(warnings),
            **about,
            **_weights_and_hours(folder),
        )

    def _evaluated(
        self, candidate: Candidate, protocol: Protocol
    ) -> tuple[Report, dict[str, Figure], dict[str, Figure]]:
        """Returns the report of the last split, and the figures of a candidate and of the truth.

        A table of several splits has the FID of each.
        """
        data, evaluator = self.work.dataset, self.evaluator
        reports = {
            split: evaluate(candidate, data, evaluator, replace(protocol, split=split))
            for split in self.splits
        }
        report = reports[self.splits[-1]]
        figures, truth = dict(report[candidate.row]), dict(report[GROUND_TRUTH])
        for split, each in reports.items() if self.table.splits else ():
            for name, row in ((candidate.row, figures), (GROUND_TRUTH, truth)):
                row |= {f"FID {split}": each[name]["FID"]} if "FID" in each[name] else {}
        return report, figures, truth

    def _candidate(self, row: Row, folder: Path | None) -> Candidate:
        if folder is None:
            # The real motions are a VAE's that changes nothing.
            model = self.work.models[next(row.model for row in self.table.rows if row.model)]
            experiment = self.work.budget.shrink(model.experiment())
            latents = replace(experiment.latents, normalized=False)
            first = frames_as_first_stage(replace(experiment, latents=latents), self.work.dataset)
            return Reconstructed(first.vae, first.card)
        if row.motions == "prior":
            return Prior(torch_prior(folder))
        if row.motions == "reconstructed":
            model = load_stages(folder)
            if not model.card.vae.has_weights:
                raise InputError(f"{folder} has no VAE to rebuild motions with")
            return Reconstructed(model.vae, model.card)
        pipeline = self.pipeline(row)
        return Generated(pipeline, pipeline.card.sampling.but(row.steps, row.guidance, row.sampler))

    def _cost(
        self, row: Row, candidate: Generated, folder: Path, protocol: Protocol
    ) -> dict[str, Figure]:
        """Times few motions of one length, so that rows of 1000 steps can be timed too."""
        test_set = build_test_set([candidate], self.work.dataset, self.evaluator, protocol)
        prompts = [longest_of(test_set.replication(0).prompts)] * TIMED
        name = next((name for name in TIMES if name in self.table.metrics), "AITS")
        cost = cost_of(folder, candidate, prompts, self._encoder(row), TIMES[name])
        assert cost.aits is not None and cost.gflops is not None
        latents, frames = candidate.card.latents, prompts[0].frames
        further = {"Input numbers": Figure(latents.tokens_of(frames) * latents.width)}
        if "Time of 2,048" in self.table.metrics:
            start = time.perf_counter()
            candidate.generate(prompts[:1] * BATCH, list(range(BATCH)))
            further["Time of 2,048"] = Figure((time.perf_counter() - start) * 2048 / BATCH)
        return further | {
            name: Figure(cost.aits),
            "GFLOPs": Figure(cost.gflops),
            "Parameters": Figure(cost.parameters["together"] / 1e6),
        }


def _weights_and_hours(folder: Path) -> dict[str, Any]:
    return {"weights": sha256(folder / WEIGHTS_FILE), "hours": read_card(folder).provenance.hours}


def _plain(figures: Mapping[str, Figure]) -> dict[str, list[float | None]]:
    """Replaces NaN, which JSON lacks and some metrics of too few motions are, by None."""
    return {
        name: [
            value if value is not None and isfinite(value) else None
            for value in (figure.mean, figure.interval)
        ]
        for name, figure in figures.items()
    }


def write_page(page: Path, table: Table, result: TableResult, says: str) -> None:
    """Writes the page of a table, and beside it its figures as JSON and its plot, if it has one.

    Args:
        page: Markdown file to write.
        table: The table.
        result: Its measured rows.
        says: Description of the budget.
    """
    write_json(page.with_suffix(".json"), result)
    text, plot = markdown(table, result, says), page.with_suffix(".svg")
    if draw_figure(table, result, plot):
        text += f"\n![{table.title}]({plot.name})\n"
    write_file(page, text)


SEED = "denoiser_training.seed="  # Setting that may differ between the runs.


def join_runs(table: Table, folders: Sequence[Path], output: Path) -> Path:
    """Writes OUTPUT/TABLE.md, .json and .svg, and OUTPUT/TABLE_2.md of a second evaluator.

    Args:
        table: The table.
        folders: Output folders of `latentmotion experiment run`.
        output: Folder to write.

    Returns:
        The page of the first evaluator.

    Raises:
        InputError: A folder has no such table, they differ in data or protocol, or a row in more
            than the seed.
    """
    results = [read_json(TableResult, folder / f"{table.name}.json") for folder in folders]
    settings = [row.made for result in results for row in result.rows]
    if len({(run["data"], run["protocol"]) for run in settings}) != 1:
        raise InputError(
            f"{table.name}: the runs in {', '.join(map(str, folders))} differ in data or protocol; "
            "join runs that differ in seed, evaluator or lengths of training"
        )
    says = _without_seed(settings[0]["budget"])
    evaluators = dict.fromkeys(result.rows[0].made["evaluator"] for result in results)
    pages = []
    for number, evaluator in enumerate(evaluators, start=1):
        theirs = [run for run in results if run.rows[0].made["evaluator"] == evaluator]
        joined = []
        for row in table.rows:
            rows = [each for run in theirs for each in run.rows if each.row == row.name]
            if not rows:
                continue
            both = joined_row(rows)
            budgets = {_without_seed(each.made["budget"]) for each in rows}
            if len(budgets) > 1 and len({each.weights for each in rows}) > 1:
                raise InputError(
                    f"{table.name}/{row.name} was trained in {len(budgets)} ways: "
                    f"{' / '.join(sorted(budgets))}; join runs of one"
                )
            if says not in budgets and row.motions != "real":
                changed = max(budgets).partition("changed: ")[2]
                both = replace(both, warnings=(*both.warnings, f"trained with {changed}"))
            joined.append(both)
        name = table.name if number == 1 else f"{table.name}_{number}"
        pages.append(replace(theirs[0], table=name, rows=tuple(joined)))
    output.mkdir(parents=True, exist_ok=True)
    for number, result in enumerate(pages, start=1):
        titled = replace(table, title=f"{table.title}, by evaluator {number}", expects="")
        write_page(output / f"{result.table}.md", titled if number > 1 else table, result, says)
    return output / f"{table.name}.md"


def joined_row(rows: Sequence[RowResult]) -> RowResult:
    """Returns the row of several trainings, each measured once; a single one is returned as it is.

    Args:
        rows: One per training.
    """
    if len({row.weights for row in rows}) < 2:
        return rows[0]
    figures: dict[str, list[float | None]] = {}
    for name in rows[0].figures:
        means = [row.figures[name][0] for row in rows if name in row.figures]
        values = [mean for mean in means if mean is not None]
        figures[name] = [fmean(values) if values else None, interval(values)]
    note = (
        f"mean of {len(rows)} trainings of the denoiser, ± the 95 % interval of that mean by "
        "Student's t, where other rows have that of their replications"
    )
    hours = fmean(row.hours for row in rows)
    warnings = list(dict.fromkeys(w for row in rows for w in row.warnings))
    return replace(rows[0], figures=figures, hours=hours, warnings=(*warnings, note))


def interval(values: Sequence[float]) -> float | None:
    """Returns half of the 95 % interval of a mean of few independent values; None of one."""
    from scipy.stats import t

    if len(values) < 2:
        return None
    return float(t.ppf(0.975, len(values) - 1)) * stdev(values) / sqrt(len(values))


def _without_seed(says: str) -> str:
    return ", ".join(part for part in says.split(", ") if SEED not in part)
