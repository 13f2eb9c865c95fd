"""Protocols on synthetic figures with evaluators of closed form: rows, seeds, quirks, notes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import ActionTask, UnconditionalTask
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import DataError, FileFormatError, InputError, ModelError
from latentmotion.evaluation.candidates import Generated, Prior, Reconstructed
from latentmotion.evaluation.evaluate import (
    Comparison,
    PublishedGroundTruth,
    build_test_set,
    compare,
    departures,
    evaluate,
)
from latentmotion.evaluation.evaluators.action import MotionGRUConfig, Recognizer
from latentmotion.evaluation.evaluators.interface import Recognition
from latentmotion.evaluation.protocol import CLEAN, PAPER, Protocol, Repeats
from latentmotion.evaluation.report import GROUND_TRUTH, Figure, Report
from latentmotion.evaluation.scores import groups
from latentmotion.model.card import ModelCard, find_model, read_card
from latentmotion.model.config import ConvolutionalVAEConfig, IdentityVAEConfig
from latentmotion.networks.backend import torch_prior
from latentmotion.networks.checkpoint import build
from latentmotion.storage import shards
from latentmotion.storage.shards import ShardSubset, folder_at
from tests.support.moving_figures import write_moving_figures

SMALL = replace(CLEAN, replications=3, split="val", repeats=Repeats(4, 3, None, 2))
AS_AUTHORS = replace(PAPER, replications=3, split="val", repeats=Repeats(4, 6, 5, 3))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=4, val=9))


def card(**changes: Any) -> ModelCard:
    return replace(read_card(find_model("starter")), **changes)


@dataclass(frozen=True)
class Echo:
    """A text-motion evaluator: mean features; every caption is the same point."""

    width: int = 263
    fingerprint: str = "echo"

    def motions(self, features: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack([motion.mean(axis=0) for motion in features])

    def texts(self, captions: Sequence[Caption]) -> np.ndarray:
        return np.stack([np.full(self.width, len(caption.text), float) for caption in captions])


@dataclass(frozen=True)
class Official(Echo):
    """The same, as if it were the one that papers use."""

    official: bool = True


@dataclass(frozen=True)
class Answers:
    """A generator that answers with noise of its seed, or with the motions it was given."""

    card: ModelCard
    known: dict[tuple[str, int], np.ndarray]

    def generate(self, request: GenerationRequest) -> list[np.ndarray]:
        return [
            self.known[prompt, length]
            if (prompt, length) in self.known
            else np.random.default_rng(seed).standard_normal((length, 263)).astype(np.float32)
            for prompt, length, seed in zip(
                request.prompts, request.frames, request.seeds, strict=True
            )
        ]


def noise_model() -> Generated:
    return Generated(Answers(card(), {}))


def values(report: Report, row: str, metric: str) -> tuple[float, ...]:
    return report[row][metric].values


def test_every_row_and_metric_of_a_text_model(dataset: Dataset) -> None:
    report = evaluate(noise_model(), dataset, Echo(), SMALL)
    assert list(report.rows) == [GROUND_TRUTH, "generated"]
    seen = {"FID", "KID", "R@1", "R@2", "R@3", "MM-Dist", "Diversity"}
    assert seen | {"MultiModality", "APE root", "AVE joints"} < set(report["generated"])
    assert seen | {"Foot sliding", "Jitter", "Penetration"} < set(report[GROUND_TRUTH])
    assert report.items == {GROUND_TRUTH: 9, "generated": 9}
    assert len(values(report, "generated", "FID")) == 3
    assert len(values(report, "generated", "MultiModality")) == 2
    assert report["generated"]["Nearest clip"].interval is None
    assert report["generated"]["FID"].mean > report[GROUND_TRUTH]["FID"].mean


def test_the_same_seed_repeats_and_replications_differ(dataset: Dataset) -> None:
    one, same = (evaluate(noise_model(), dataset, Echo(), SMALL) for _ in range(2))
    assert one.rows == same.rows
    assert len(set(values(one, "generated", "FID"))) == 3
    other = evaluate(noise_model(), dataset, Echo(), replace(SMALL, seed=1))
    assert values(other, "generated", "FID") != values(one, "generated", "FID")
    fewer = evaluate(noise_model(), dataset, Echo(), replace(SMALL, replications=1))
    assert values(fewer, "generated", "FID") == values(one, "generated", "FID")[:1]
    assert fewer["generated"]["FID"].interval is None


def test_replications_in_shards_give_the_same_report(dataset: Dataset, tmp_path: Path) -> None:
    comparison = Comparison((noise_model(),), dataset, Echo(), SMALL)
    folder = folder_at(tmp_path / "replications", create=True)
    assert shards.make(comparison.work(), folder, ShardSubset(2, 2)) is None
    manifest = shards.make(comparison.work(), folder, ShardSubset(1, 2))
    assert manifest is not None and len(manifest.shards) == 3
    assert comparison.report_of(folder, manifest).rows == comparison().rows
    other = Comparison((noise_model(),), dataset, Echo(), replace(SMALL, seed=1))
    with pytest.raises(InputError, match="another run"):
        shards.make(other.work(), folder)
    (folder / "replication-00001.json").write_bytes(b"{")
    with pytest.raises(FileFormatError, match="replication-00001"):
        comparison.report_of(folder, manifest)


def test_who_answers_with_the_truth_is_perfect(dataset: Dataset) -> None:
    clips = dataset.clips("val")
    lengths = [clip.frames // 4 * 4 for clip in clips]
    known = {
        (clip.captions[0].text, length): dataset.features(clip)[:length]
        for clip, length in zip(clips, lengths, strict=True)
    }
    # Clips of the same caption and length would answer for each other.
    assert len(known) == len(clips)
    subject = Generated(Answers(card(), known))
    protocol = replace(SMALL, repeats=Repeats(texts=0))
    report = evaluate(subject, dataset, Echo(), protocol)
    found, true = report["generated"], report[GROUND_TRUTH]
    for metric in ("FID", "APE joints", "AVE joints"):
        assert found[metric].mean == pytest.approx(0, abs=1e-5), metric
    for metric in ("R@1", "MM-Dist", "Diversity", "Jitter", "Foot sliding", "Nearest clip"):
        assert found[metric].mean == pytest.approx(true[metric].mean), metric


def test_a_vae_is_measured_by_position_too(dataset: Dataset) -> None:
    vae = build(ConvolutionalVAEConfig(width=8, channels=4)).eval()
    mean = Reconstructed(vae, card(), sampled=False, row="mean")
    drawn = Reconstructed(vae, card(), sampled=True, row="drawn")
    report = compare([mean, drawn], dataset, None, SMALL)
    assert {"MPJPE", "PA-MPJPE", "ACCL", "APE root"} < set(report["mean"])
    assert "FID" not in report["mean"] and "Nearest clip" not in report["mean"]
    assert len(set(values(report, "mean", "MPJPE"))) == 1
    assert len(set(values(report, "drawn", "MPJPE"))) == 3
    assert any("no evaluator" in note for note in report.notes)
    padded = replace(SMALL, quirks=replace(SMALL.quirks, padded_sums=True))
    as_authors = compare([mean], dataset, None, padded)
    assert as_authors["mean"]["MPJPE"].mean > report["mean"]["MPJPE"].mean
    default = compare([replace(mean, sampled=None)], dataset, None, replace(AS_AUTHORS, seed=3))
    assert len(set(values(default, "mean", "MPJPE"))) == 3


def test_an_identical_vae_has_no_error(dataset: Dataset) -> None:
    subject = Reconstructed(build(IdentityVAEConfig()).eval(), card())
    report = evaluate(subject, dataset, Echo(), AS_AUTHORS)
    for metric in ("MPJPE", "PA-MPJPE", "ACCL", "FID"):
        assert report["reconstruction"][metric].mean == pytest.approx(0, abs=0.02), metric


def test_the_quirks_of_paper(dataset: Dataset) -> None:
    report = evaluate(noise_model(), dataset, Echo(), AS_AUTHORS)
    assert report[GROUND_TRUTH]["FID"].mean == pytest.approx(0, abs=1e-6)
    assert len(set(values(report, GROUND_TRUTH, "Diversity"))) == 3
    assert len(set(values(report, GROUND_TRUTH, "Jitter"))) == 3
    assert len(values(report, "generated", "MultiModality")) == 3
    assert "diversity is of 9 pairs, not 300" in report.notes
    clean = evaluate(noise_model(), dataset, Echo(), SMALL)
    assert len(set(values(clean, GROUND_TRUTH, "Jitter"))) == 1


def test_groups_count_every_item_once_or_drop_the_rest() -> None:
    random = np.random.default_rng(0)
    parts = list(groups(85, 32, random, drop=False))
    assert [len(rows) for rows, _ in parts] == [32] * 3
    assert sorted(np.concatenate([rows[:own] for rows, own in parts])) == list(range(85))
    assert all(len(set(rows)) == 32 for rows, _ in parts)
    assert [own for _, own in groups(85, 32, random, drop=True)] == [32, 32]
    for drop in (True, False):
        assert [own for _, own in groups(9, 32, random, drop)] == [9]


def test_crops_and_captions_of_a_replication(dataset: Dataset) -> None:
    clean = build_test_set([noise_model()], dataset, None, SMALL)
    first, second = clean.replication(0), clean.replication(1)
    assert [q.start for q in first.prompts] == [0] * 9
    assert first.frames == second.frames and all(n % 4 == 0 for n in first.frames)
    assert first.frames == [clip.frames // 4 * 4 for clip in dataset.clips("val")]
    drawn = build_test_set([noise_model()], dataset, None, AS_AUTHORS)
    frames = np.array([drawn.replication(number).frames for number in range(30)])
    shorter = np.array(first.frames) - frames
    assert set(shorter.ravel()) == {0, 4}
    assert (shorter > 0).mean() == pytest.approx(1 / 3, abs=0.1)


@dataclass(frozen=True)
class Signs:
    """An action classifier of two labels, by the sign of the mean root velocity."""

    labels: tuple[str, ...] = ("back", "forth")
    fingerprint: str = "signs"

    def __call__(self, features: Sequence[np.ndarray]) -> Recognition:
        means = np.stack([motion.mean(axis=0)[:8] for motion in features])
        return Recognition(means, np.stack([-means[:, 2], means[:, 2]], axis=1))


@pytest.fixture(scope="module")
def actions(dataset: Dataset) -> Dataset:
    """The same clips, each with the label that the classifier sees in it."""
    seen = [
        replace(clip, action=Signs().labels[int(mean > 0)])
        for clip in dataset.manifest.clips
        for mean in [dataset.features(clip.clip()).mean(axis=0)[2]]
    ]
    return replace(dataset, manifest=replace(dataset.manifest, clips=tuple(seen)))


@pytest.mark.parametrize("protocol", [SMALL, AS_AUTHORS])
def test_an_action_model(actions: Dataset, protocol: Protocol) -> None:
    subject = Generated(Answers(card(condition=ActionTask()), {}))
    report = evaluate(subject, actions, Signs(), protocol)
    assert report[GROUND_TRUTH]["Accuracy"].mean > 0.85
    wanted = {"Accuracy", "FID", "KID", "Diversity", "MultiModality"}
    assert wanted < set(report["generated"])
    assert not {"R@1", "MM-Dist", "APE root"} & set(report["generated"])
    assert report[GROUND_TRUTH]["MultiModality"].mean > 0


def test_a_label_that_the_classifier_does_not_know_is_named(actions: Dataset) -> None:
    subject = Generated(Answers(card(condition=ActionTask()), {}))
    labels = Signs(labels=("up", "down"))
    with pytest.raises(InputError, match=r"does not know the label '(back|forth)'"):
        evaluate(subject, actions, labels, SMALL)


def test_the_random_state_of_a_recurrent_classifier_is_a_quirk(actions: Dataset) -> None:
    def positions(features: np.ndarray) -> np.ndarray:
        return features[:, 4:67].reshape(-1, 21, 3)

    network = MotionGRUConfig(joints=21, labels=2, hidden=8).build().eval()
    classifier = Recognizer(("back", "forth"), "gru", network, positions, 263)
    same = Reconstructed(build(IdentityVAEConfig()).eval(), card())
    quirk = replace(SMALL, quirks=replace(SMALL.quirks, random_state=True))
    clean, drawn = (evaluate(same, actions, classifier, p) for p in (SMALL, quirk))
    assert len(set(values(clean, GROUND_TRUTH, "Diversity"))) == 1
    assert len(set(values(drawn, GROUND_TRUTH, "Diversity"))) == 3


def test_unconditional_models_match_nothing(dataset: Dataset) -> None:
    report = evaluate(
        Generated(Answers(card(condition=UnconditionalTask()), {})), dataset, Echo(), SMALL
    )
    assert {"FID", "KID", "Diversity"} < set(report["generated"])
    assert not {"R@1", "MultiModality", "APE root"} & set(report["generated"])
    prior = Prior(torch_prior("starter"))
    assert {"FID", "Jitter"} < set(evaluate(prior, dataset, Echo(), SMALL)["prior"])


def test_what_does_not_fit_is_refused(dataset: Dataset) -> None:
    with pytest.raises(ModelError, match="makes features 'kit'"):
        evaluate(Generated(Answers(card(representation="kit"), {})), dataset, None, SMALL)
    with pytest.raises(InputError, match="each of another name"):
        compare([noise_model(), noise_model()], dataset, None, SMALL)
    with pytest.raises(DataError, match=r"0 clips with captions .* test split"):
        evaluate(noise_model(), dataset, None, replace(SMALL, split="test"))
    action = replace(
        noise_model(), generator=Answers(card(condition=ActionTask()), {}), row="labels"
    )
    with pytest.raises(InputError, match="evaluate them apart"):
        compare([noise_model(), action], dataset, None, SMALL)
    with pytest.raises(InputError, match="no motion of at most 8 frames"):
        evaluate(noise_model(), dataset, None, replace(SMALL, max_frames=8))
    with pytest.raises(InputError, match="0 replications"):
        replace(SMALL, replications=0)


def test_a_ground_truth_outside_its_published_interval_is_told_loudly(dataset: Dataset) -> None:
    source = replace(dataset.sources[0], name="humanml3d")
    data = replace(dataset, manifest=replace(dataset.manifest, sources=(source,)))
    with pytest.warns(UserWarning, match=r"R@1 is 0.11.*published 0.511"):
        report = evaluate(noise_model(), data, Official(), replace(SMALL, replications=1))
    assert any("MM-Dist" in line for line in report.warnings)
    assert "**Warning.** the ground truth's R@1" in report.markdown()
    own = evaluate(noise_model(), data, Echo(), replace(SMALL, replications=1))
    assert not own.warnings
    assert any("no published interval" in note for note in own.notes)


def test_departures_allow_for_both_intervals() -> None:
    published = PublishedGroundTruth("a", "b", {"R@1": (0.5, 0.01)})
    assert not departures({"R@1": Figure(0.525, 0.02)}, published)
    assert departures({"R@1": Figure(0.53, 0.01)}, published)
    assert not departures({"FID": Figure(9.0)}, published)


def test_figures() -> None:
    figure = Figure.of([1.0, 2.0, 3.0, 4.0])
    assert figure.interval == pytest.approx(1.96 * np.std([1, 2, 3, 4], ddof=1) / 2)
    authors = Figure.of([1.0, 2.0, 3.0, 4.0], population=True)
    assert authors.interval == pytest.approx(1.96 * np.std([1, 2, 3, 4]) / 2)
    assert str(figure) == "2.5 ± 1.3"
    assert str(Figure.of([1e-15])) == "0"


def test_reports_are_written_whole_and_read_back(dataset: Dataset, tmp_path: Path) -> None:
    report = evaluate(noise_model(), dataset, Echo(), SMALL)
    report.write(tmp_path / "report")
    data = json.loads((tmp_path / "report" / "report.json").read_text())
    assert data["rows"]["generated"]["FID"]["mean"] == report["generated"]["FID"].mean
    assert data["protocol"]["quirks"]["random_crops"] is False
    assert data["provenance"]["data_hash"] == dataset.fingerprint
    assert data["provenance"]["evaluator"] == "echo"
    page = (tmp_path / "report" / "report.md").read_text()
    assert "| FID ↓ |" in page and dataset.fingerprint in page
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"has no report\.json"):
        report.write(tmp_path / "other")
