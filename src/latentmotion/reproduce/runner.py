"""Table runner: trains and measures rows, and writes the page of a table.

For each row a model is trained or taken as it is, and its figures are kept until something that
determines them changes. After every row NAME.json, NAME.md and NAME.svg are written anew.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from latentmotion.condition.interface import TextEncoder
from latentmotion.errors import InputError
from latentmotion.evaluation.candidates import Candidate, Generated, Prior, Reconstructed
from latentmotion.evaluation.cost import cost_of, longest_of
from latentmotion.evaluation.evaluate import build_test_set, evaluate
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.evaluation.protocol import Protocol
from latentmotion.evaluation.report import GROUND_TRUTH, Figure
from latentmotion.gpu.backend import torch_pipeline, torch_prior
from latentmotion.model.card import read_card
from latentmotion.networks.checkpoint import WEIGHTS_FILE, load_stages
from latentmotion.pipeline import MotionPipeline
from latentmotion.progress import counted
from latentmotion.reproduce.markdown import RowResult, TableResult, markdown
from latentmotion.reproduce.plots import draw_figure, draw_latents
from latentmotion.reproduce.table import Row, Table
from latentmotion.reproduce.training_cost import training_cost
from latentmotion.reproduce.workspace import Workspace, vae_cost
from latentmotion.storage.configuration import read_json, to_json, write_json
from latentmotion.storage.files import atomic_file, sha256
from latentmotion.training.loop import read_progress
from latentmotion.training.run_folder import Run, read_run

SLOW = 1000
"""Sampling steps from which a row has fewer replications."""

TIMES = {"AITS": time.perf_counter, "Processor time": time.process_time}
"""Clock of each metric of a motion's time. Processor time is that of all threads: with one it is
the time on a quiet machine."""

TIMED = 3
"""Motions of a row that are timed."""


@dataclass(frozen=True)
class TableRunner:
    """Trains and measures the rows of a table."""

    table: Table
    """The table."""
    work: Workspace
    """Data, models and sizes."""
    protocol: Protocol
    """Protocol of the evaluation."""
    evaluator: Evaluator | None
    """Evaluator of FID and other metrics of embeddings; None for metrics of positions alone."""

    def run(self, rows: Sequence[Row]) -> Path:
        """Trains and measures rows; returns the Markdown page, with the rows of earlier runs too.

        Raises:
            InputError: A folder holds another run.
            DataError: The data cannot be used for this table.
        """
        page = self.work.folder / f"{self.table.name}.md"
        for row in counted(rows, "rows"):
            if row.kind != "real":
                self.row(row)
                # After every row, so that an interrupted run leaves what it has measured.
                self.write_page(page)
        return page

    def row(self, row: Row) -> RowResult:
        """Trains the missing stages and measures a row, unless its figures are there."""
        vae_alone = row.kind in ("reconstructed", "prior")
        train = self.work.first_stage if vae_alone else self.work.both_stages
        folder = train(row.model)
        protocol = self._protocol(row)
        path = self.work.folder / self.table.name / f"{row.name}.json"
        key = self._key(row, folder, protocol)
        if path.is_file():
            kept = read_json(RowResult, path)
            if (kept.key, kept.made) == (key, self.made):
                return kept
        self.work.tell(f"{self.table.name}/{row.name}: measuring {folder}")
        if row.kind == "latents":  # drawn along the reverse process, which needs no replications
            figures = draw_latents(self.pipeline(row), self.work.folder / f"{self.table.name}.svg")
            about = {"made": self.made, **_weights_and_hours(folder)}
            result = RowResult(row.name, key, _plain(figures), replications=1, **about)
        else:
            result = self._measured(row, folder, protocol, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, result)
        return result

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
        return torch_pipeline(self.work.both_stages(row.model), self._encoder(row))

    def write_page(self, page: Path) -> None:
        """Writes the page of a table with all rows that are measured so far."""
        result = self.measured_rows()
        write_json(page.with_suffix(".json"), result)
        text = markdown(self.table, result, self.work.budget.says)
        plot = page.with_suffix(".svg")
        if draw_figure(self.table, self.work.vaes or self.work.folder, result, plot):
            text += f"\n![{self.table.title}]({plot.name})\n"
        with atomic_file(page) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def measured_rows(self) -> TableResult:
        """Returns the rows that are measured so far, in the table's order."""
        table, work, protocol = self.table, self.work, self.protocol
        folder = work.folder / table.name
        paths = {row.name: folder / f"{row.name}.json" for row in table.rows}
        kept = {name: read_json(RowResult, path) for name, path in paths.items() if path.is_file()}
        kept = {name: row for name, row in kept.items() if row.made == self.made}
        real = next((row.name for row in table.rows if row.kind == "real"), None)
        first = next(iter(kept.values()), None)
        if real and first:
            # The row of the real motions is the ground truth of the first other row.
            row = replace(first, row=real, figures=first.truth, weights="", warnings=())
            kept = {real: row} | kept
        evaluator = self.evaluator.fingerprint[:12] if self.evaluator else "none"
        return TableResult(
            table=table.name,
            budget=work.budget.name,
            data=f"{work.dataset.folder.name} ({work.dataset.fingerprint[:12]})",
            protocol=f"{protocol.name}, split {protocol.split}, {protocol.replications} "
            f"repetitions, evaluator {evaluator}",
            rows=tuple(kept[row.name] for row in table.rows if row.name in kept),
        )

    def _encoder(self, row: Row) -> TextEncoder | None:
        model = self.work.models[row.model]
        return None if model.shipped else self.work.encoder_of(model)

    def _protocol(self, row: Row) -> Protocol:
        """Slow rows have fewer replications; MultiModality is measured only where it is printed."""
        protocol, slow = self.protocol, (row.steps or 0) >= SLOW
        if slow:
            most = self.work.budget.slow
            protocol = replace(protocol, replications=min(protocol.replications, most))
        printed = "MultiModality" in self.table.metrics and not slow
        repeats = replace(protocol.repeats, texts=protocol.repeats.texts if printed else 0)
        return replace(protocol, repeats=repeats, nearest_clip=False)

    def _key(self, row: Row, folder: Path, protocol: Protocol) -> str:
        """Hash of everything that determines the figures of a row."""
        inputs: dict[str, Any] = {
            "row": to_json(replace(row, title="", paper={})),
            "weights": sha256(folder / WEIGHTS_FILE),
            "data": self.work.dataset.fingerprint,
            "evaluator": self.evaluator.fingerprint if self.evaluator else "",
            "protocol": to_json(protocol),
            "metrics": list(self.table.metrics),
        }
        text = json.dumps(inputs, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def _measured(self, row: Row, folder: Path, protocol: Protocol, key: str) -> RowResult:
        candidate = self._candidate(row, folder)
        report = evaluate(candidate, self.work.dataset, self.evaluator, protocol)
        figures = dict(report[candidate.row])
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
        if model.equal:
            steps = read_run(Run, folder.parent).experiment.denoiser_training.steps
            warnings.append(
                f"trained for {steps:,} steps, as many {model.equal} as both stages of MLD-1 of z₀"
            )
        vae = self.work.run_folders(row.model)[0] if self.work.vaes and not model.shipped else None
        if vae:
            training = read_run(Run, vae).experiment.vae_training
            steps = read_progress(vae).step or training.steps
            taken = f"{steps:,} steps of {training.batch_size}, {training.schedule} rate"
            warnings.append(f"its VAE was taken as it was: {taken}")
        return RowResult(
            row=row.name,
            key=key,
            figures=_plain(figures),
            truth=_plain(report[GROUND_TRUTH]),
            items=report.items[candidate.row],
            replications=protocol.replications,
            versions=dict(report.provenance.versions),
            notes=report.notes,
            warnings=tuple(warnings),
            made=self.made,
            **_weights_and_hours(folder),
        )

    def _candidate(self, row: Row, folder: Path) -> Candidate:
        if row.kind == "prior":
            return Prior(torch_prior(folder))
        if row.kind == "reconstructed":
            model = load_stages(folder)
            if not model.card.vae.has_weights:
                raise InputError(f"{folder} has no VAE to rebuild motions with")
            return Reconstructed(model.vae, model.card)
        pipeline = self.pipeline(row)
        sampling = pipeline.card.sampling.but(row.steps, row.guidance, row.sampler)
        return Generated(pipeline, sampling)

    def _cost(
        self, row: Row, candidate: Generated, folder: Path, protocol: Protocol
    ) -> dict[str, Figure]:
        """Times few motions of one length, so that rows of 1000 steps can be timed too."""
        test_set = build_test_set([candidate], self.work.dataset, self.evaluator, protocol)
        prompts = [longest_of(test_set.replication(0).prompts)] * TIMED
        name = next((name for name in TIMES if name in self.table.metrics), "AITS")
        cost = cost_of(folder, candidate, prompts, self._encoder(row), TIMES[name])
        assert cost.aits is not None and cost.gflops is not None
        return {
            name: Figure(cost.aits),
            "GFLOPs": Figure(cost.gflops),
            "Parameters": Figure(cost.parameters["together"] / 1e6),
        }


def _weights_and_hours(folder: Path) -> dict[str, Any]:
    hours = read_card(folder).provenance.hours
    return {"weights": sha256(folder / WEIGHTS_FILE), "hours": hours}


def _plain(figures: Mapping[str, Figure]) -> dict[str, list[float | None]]:
    """Replaces NaN, which JSON lacks and some metrics of too few motions are, by None."""
    return {
        name: [
            value if value is not None and isfinite(value) else None
            for value in (figure.mean, figure.interval)
        ]
        for name, figure in figures.items()
    }
