"""One row: train or take its model, measure it, keep the figures until something changes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from latentmotion.checkpoint import WEIGHTS_FILE, load_stages
from latentmotion.condition.interface import TextEncoder
from latentmotion.errors import InputError
from latentmotion.evaluation.cost import cost_of, longest_of
from latentmotion.evaluation.extractors.interface import ActionExtractor, TextMotionExtractor
from latentmotion.evaluation.protocol import evaluate, plan_of
from latentmotion.evaluation.report import TRUTH, Figure, Report
from latentmotion.evaluation.settings import Protocol
from latentmotion.evaluation.subject import Generated, Prior, Reconstructed, Subject
from latentmotion.experiments.result import RowResult
from latentmotion.experiments.reverse import draw_latents
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.vae_cost import vae_cost
from latentmotion.experiments.workplace import Workplace
from latentmotion.model.card import read_card
from latentmotion.pipeline import MotionPipeline
from latentmotion.runtime.eager import torch_pipeline, torch_prior
from latentmotion.storage.configuration import read_json, to_json, write_json
from latentmotion.storage.files import sha256
from latentmotion.vae.interface import MotionVAE

SLOW = 1000
"""Sampling steps from which a row is repeated less often."""

TIMED = 3
"""Motions of a row that are timed."""


@dataclass(frozen=True)
class Measurement:
    """How the rows of a table are measured."""

    table: Table
    """The table."""
    work: Workplace
    """Data, models and sizes."""
    protocol: Protocol
    """How often, and by whose habits."""
    extractor: TextMotionExtractor | ActionExtractor | None
    """What FID and its like look through."""

    def row(self, row: Row) -> RowResult:
        """Trains what is missing, measures the row, or takes the figures that are there."""
        folder = self._model(row)
        protocol, path = (
            self._protocol(row),
            self.work.folder / self.table.name / f"{row.name}.json",
        )
        key = self._key(row, folder, protocol)
        if path.is_file():
            found = read_json(RowResult, path)
            if (found.key, found.made) == (key, self.made):
                return found
        self.work.tell(f"{self.table.name}/{row.name}: measuring {folder}")
        result = self._measured(row, folder, protocol, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, result)
        return result

    @property
    def made(self) -> dict[str, str]:
        """What all rows of a page have in common."""
        return {
            "data": self.work.dataset.fingerprint,
            "evaluator": self.extractor.fingerprint if self.extractor else "",
            "protocol": self.protocol.name,
            "budget": self.work.budget.says,
        }

    def generator(self, row: Row) -> MotionPipeline:
        """Returns the trained model of a row, ready to generate."""
        return torch_pipeline(self._model(row), self._encoder(row))

    def _encoder(self, row: Row) -> TextEncoder | None:
        model = self.work.model(row.model)
        return None if model.base == "starter" else self.work.encoder_of(model)

    def _model(self, row: Row) -> Path:
        if row.kind in ("reconstructed", "prior"):
            return self.work.first_stage(row.model)
        return self.work.both_stages(row.model)

    def _protocol(self, row: Row) -> Protocol:
        """Slow rows are repeated less often, and only tables that print it ask for varieties."""
        protocol, most = self.protocol, self.work.budget.slow
        if (row.steps or 0) >= SLOW:
            protocol = replace(protocol, replications=min(protocol.replications, most))
        wanted = "MultiModality" in self.table.metrics and (row.steps or 0) < SLOW
        texts = protocol.repeats.texts if wanted else 0
        repeats = replace(protocol.repeats, texts=texts)
        return replace(protocol, repeats=repeats, nearest_clip=False)

    def _measured(self, row: Row, folder: Path, protocol: Protocol, key: str) -> RowResult:
        if row.kind == "latents":
            return self._drawn(row, folder, key)
        subject = self._subject(row, folder)
        report = evaluate(subject, self.work.dataset, self.extractor, protocol)
        figures = dict(report[subject.row])
        if isinstance(subject, Generated) and {"AITS", "GFLOPs"} & set(self.table.metrics):
            figures |= self._cost(row, subject, folder, protocol)
        if isinstance(subject, Reconstructed) and "Decoding" in self.table.metrics:
            figures |= self._vae_cost(subject.vae)
        return RowResult(
            row=row.name,
            key=key,
            figures=_plain(figures),
            truth=_plain(report[TRUTH]),
            items=report.items[subject.row],
            replications=protocol.replications,
            versions=dict(report.provenance.versions),
            notes=report.notes,
            warnings=(*report.warnings, *self._warnings(row, report)),
            made=self.made,
            **_model(folder),
        )

    def _cost(
        self, row: Row, subject: Generated, folder: Path, protocol: Protocol
    ) -> dict[str, Figure]:
        """Times few motions of one length, so that rows of 1000 steps can be timed too."""
        trial = plan_of([subject], self.work.dataset, self.extractor, protocol).trial(0)
        asked = [longest_of(trial.questions)] * TIMED
        cost = cost_of(folder, subject, asked, self._encoder(row))
        assert cost.aits is not None and cost.gflops is not None
        return {
            "AITS": Figure(cost.aits),
            "GFLOPs": Figure(cost.gflops),
            "Parameters": Figure(cost.parameters["together"] / 1e6),
        }

    def _vae_cost(self, vae: MotionVAE) -> dict[str, Figure]:
        representation = self.work.dataset.representation
        return vae_cost(vae, representation.width, representation.fps)

    def _drawn(self, row: Row, folder: Path, key: str) -> RowResult:
        path = self.work.folder / f"{self.table.name}.png"
        figures = draw_latents(self.generator(row), path)
        about = {"made": self.made, **_model(folder)}
        return RowResult(row.name, key, _plain(figures), replications=1, **about)

    def _subject(self, row: Row, folder: Path) -> Subject:
        if row.kind == "prior":
            return Prior(torch_prior(folder))
        if row.kind == "reconstructed":
            model = load_stages(folder)
            if not model.card.vae.has_weights:
                raise InputError(f"{folder} has no VAE to rebuild motions with")
            return Reconstructed(model.vae, model.card)
        generator = self.generator(row)
        sampling = generator.card.sampling.but(row.steps, row.guidance, row.sampler)
        return Generated(generator, sampling)

    def _warnings(self, row: Row, report: Report) -> list[str]:
        asked, count = self.protocol.replications, report.protocol.replications
        first, changed = self.work.model(row.model).first, self.work.budget.of_models
        changes = (*changed.get(row.model, ()), *changed.get(first, ()))
        fewer = [f"measured {count} times instead of {asked}"] if count < asked else []
        return [*fewer, *([f"trained with {', '.join(changes)}"] if changes else [])]

    def _key(self, row: Row, folder: Path, protocol: Protocol) -> str:
        decides: dict[str, Any] = {
            "row": to_json(replace(row, title="", paper={})),
            "weights": sha256(folder / WEIGHTS_FILE),
            "data": self.work.dataset.fingerprint,
            "evaluator": self.extractor.fingerprint if self.extractor else "",
            "protocol": to_json(protocol),
            "metrics": list(self.table.metrics),
        }
        text = json.dumps(decides, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()


def _model(folder: Path) -> dict[str, Any]:
    """What a row says of its model."""
    hours = read_card(folder).provenance.hours
    return {"weights": sha256(folder / WEIGHTS_FILE), "hours": hours}


def _plain(figures: Mapping[str, Figure]) -> dict[str, list[float | None]]:
    """JSON knows no NaN, which some metrics of too few motions are."""
    return {
        name: [value if value is not None and isfinite(value) else None for value in pair]
        for name, pair in ((name, (f.mean, f.interval)) for name, f in figures.items())
    }
