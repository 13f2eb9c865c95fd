"""Reports in words: tables, notes, costs, hashes; and the figures of a card."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import ModelError
from latentmotion.evaluation import cost as cost_file
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.cost import (
    TIMED,
    Cost,
    generation_flops,
    longest_of,
    timed_prompts,
)
from latentmotion.evaluation.evaluate import (
    PUBLISHED,
    departures,
    notes_of,
    published_ground_truth,
)
from latentmotion.evaluation.evaluators.interface import evaluator_kind, load_evaluator
from latentmotion.evaluation.protocol import (
    AUTHORS,
    CLEAN,
    Lengths,
    Quirks,
    Repeats,
    TestItem,
    TestPrompt,
    TestSet,
)
from latentmotion.evaluation.report import (
    GROUND_TRUTH,
    UNITS,
    Figure,
    Report,
    ReportProvenance,
    card_figures,
    provenance_of,
    statistics_hash,
    table_line,
    weights_hash,
)
from latentmotion.evaluation.scores import (
    PositionScores,
    body_of,
    lacks_smpl_joints,
    notes_on_joints,
)
from latentmotion.model.card import find_model, read_card
from latentmotion.model.config import Sampling
from tests.support.moving_figures import write_moving_figures

MADE = ReportProvenance(
    data="set",
    data_hash="d1",
    weights={"fast": "w1", "slow": "w1", "other": ""},
    statistics={"fast": "s1", "slow": "s1", "other": "s2"},
    models={"fast": "starter", "slow": "starter", "other": "mine"},
    sampling={"fast": ", 2 steps", "slow": ", 50 steps", "other": ""},
    evaluator="",
    body="",
    versions={"numpy": "2", "machine": "m"},
)
ROWS = {
    GROUND_TRUTH: {"Own metric": Figure(1.0), "R@1": Figure(0.5, 0.01), "MPJPE": Figure(0.0)},
    "fast": {"FID": Figure(12.34567, 0.0123), "R@1": Figure(0.25)},
}
REPORT = Report(ROWS, {GROUND_TRUTH: 9, "fast": 8}, CLEAN, MADE, notes=("n1", "n2"))


@dataclass(frozen=True)
class Reader:
    """A text-motion evaluator of some width, official or not."""

    width: int = 4
    fingerprint: str = "reader"
    official: bool = True

    def motions(self, features: Sequence[np.ndarray]) -> np.ndarray:
        return np.zeros((len(features), self.width))

    def texts(self, captions: Sequence[object]) -> np.ndarray:
        return np.zeros((len(captions), self.width))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=1, val=5))


@pytest.mark.parametrize(
    ("figure", "text"),
    [
        (Figure(0.123456), "0.1235"),
        (Figure(1234567.0, 0.0), "1.235e+06 ± 0"),
        (Figure(-3e-10, 4e-10), "0 ± 0"),
        (Figure(2.0, 0.014567), "2 ± 0.015"),
    ],
)
def test_figures_have_four_digits_and_intervals_two(figure: Figure, text: str) -> None:
    assert str(figure) == text


def test_a_table_has_every_metric_in_order() -> None:
    assert REPORT.metrics == ["MPJPE", "FID", "R@1", "Own metric"]
    assert REPORT.table().splitlines() == [
        "| metric | ground truth | fast |",
        "|---|---|---|",
        f"| MPJPE {UNITS['MPJPE']} | 0 | – |",
        "| FID ↓ | – | 12.35 ± 0.012 |",
        "| R@1 ↑ | 0.5 ± 0.01 | 0.25 |",
        "| Own metric | 1 | – |",
    ]
    assert table_line(["a", "b"]) == "| a | b |"


def test_a_page_joins_rows_of_one_model() -> None:
    page = REPORT.markdown()
    assert page.startswith("# starter, mine: clean protocol\n\n| metric")
    assert "* starter: weights w1, statistics s1 (fast, 2 steps; slow, 50 steps)" in page
    assert "* mine: weights not from a folder, statistics s2 (other)" in page
    assert "* evaluator none\n" in page and "* body" not in page and "Warning" not in page
    assert "* n1\n* n2\n" in page and page.endswith("machine m\n")


def test_a_page_begins_with_warnings_and_tells_the_cost() -> None:
    cost = Cost({"vae": 1234567, "together": 1234567}, 2.5, 196, 0.0123, 7, "after 3")
    told = replace(REPORT, cost=cost, warnings=("w1", "w2"), provenance=replace(MADE, body="b1"))
    page = told.markdown()
    assert "\n\n> **Warning.** w1\n> **Warning.** w2\n\n| metric" in page
    assert "* parameters: vae 1,234,567, together 1,234,567\n" in page
    assert "* FLOPs: 2.50 G for 196 frames\n" in page
    assert "* AITS: 0.0123 s (7 motions one at a time, after 3)\n" in page
    assert "* body b1\n" in page
    assert Cost({"vae": 3}).lines() == ["parameters: vae 3"]


def test_a_card_gets_means_alone() -> None:
    figures = card_figures(REPORT)
    assert figures["rows"]["fast"] == {"FID": 12.35, "R@1": 0.25}
    assert figures["motions"] == {GROUND_TRUTH: 9, "fast": 8}
    assert (figures["data"], figures["protocol"], figures["seed"]) == ("set d1", "clean", 0)


def notes(dataset: Dataset, evaluator: Reader | None, **changes) -> list[str]:
    protocol = replace(CLEAN, split="val", **changes)
    test_set = TestSet(dataset, protocol, "text", Lengths(8, 40, 4))
    return notes_of(test_set, evaluator, None)


@pytest.mark.parametrize(
    ("evaluator", "changes", "note", "there"),
    [
        (None, {}, "no evaluator, so metrics of positions alone", True),
        (None, {}, "no published interval", False),
        (Reader(), {}, "R-precision ranks among 5 motions", True),
        (Reader(), {"group": 2}, "R-precision ranks", False),
        (Reader(), {"group": 2, "quirks": Quirks(remainder_dropped=True)}, "1 items of each", True),
        (Reader(width=5), {}, "5 motions and 5 features is biased upward", True),
        (Reader(width=4), {}, "biased upward", False),
        (Reader(), {"quirks": AUTHORS}, "diversity is of 5 pairs, not 300", True),
        (Reader(), {}, "MultiModality is of 5 captions, not 100", True),
        (Reader(), {"repeats": Repeats(5)}, "MultiModality is of", False),
        (Reader(), {}, "between random halves of 2 motions", True),
        (Reader(), {"quirks": Quirks(permuted_truth=True)}, "random halves", False),
        (Reader(), {}, "searched in the first replication only", True),
        (Reader(), {"nearest_clip": False}, "nearest training clip", False),
        (Reader(), {}, "no published interval is known", True),
    ],
)
def test_notes_tell_what_few_motions_do(
    dataset: Dataset, evaluator: Reader | None, changes: dict, note: str, there: bool
) -> None:
    told = notes(dataset, evaluator, **changes)
    assert told[0].startswith("5 items with captions of 8 to 40 frames, from 5 clips of the val")
    assert any(note in line for line in told) is there


@pytest.mark.parametrize(
    ("sources", "evaluator", "paper"),
    [
        (["humanml3d"], Reader(), "MLD (CVPR 2023), table 1"),
        (["kit"], Reader(), "MLD (CVPR 2023), table 2"),
        (["cmu"], Reader(), None),
        (["humanml3d", "kit"], Reader(), None),
        (["humanml3d"], Reader(official=False), None),
        (["humanml3d"], None, None),
    ],
)
def test_a_published_row_is_for_one_data_set_and_its_evaluator(
    dataset: Dataset, sources: list[str], evaluator: Reader | None, paper: str | None
) -> None:
    known = tuple(replace(dataset.sources[0], name=name) for name in sources)
    data = replace(dataset, manifest=replace(dataset.manifest, sources=known))
    found = published_ground_truth(data, evaluator)
    assert (found.paper if found else None) == paper


@pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: row.source)
def test_published_rows_do_not_depart_from_themselves(row) -> None:
    same = {name: Figure(mean, interval) for name, (mean, interval) in row.figures.items()}
    assert not departures(same, row)
    far = {name: Figure(mean * 1.5) for name, (mean, _) in row.figures.items()}
    assert len(departures(far, row)) == len(row.figures)


def test_the_hash_of_weights_is_of_names_and_contents(tmp_path: Path) -> None:
    def hashed(**files: str) -> str:
        for path in tmp_path.iterdir():
            path.unlink()
        for name, content in files.items():
            (tmp_path / name.replace("__", ".")).write_text(content)
        return weights_hash(tmp_path)

    first = hashed(weights__safetensors="a", decoder__onnx="b", model__json="{}")
    assert hashed(decoder__onnx="b", weights__safetensors="a", model__json="other") == first
    changed = [
        hashed(weights__safetensors="a", decoder__onnx="c"),
        hashed(weights__safetensors="b", decoder__onnx="a"),
        hashed(weights__safetensors="a", denoiser__onnx="b"),
        hashed(weights__safetensors="a", decoder__onnx="b", tokenizer__json="{}"),
    ]
    assert len({first, *changed}) == 5


def test_the_provenance_names_sampling_of_what_is_sampled(dataset: Dataset) -> None:
    card = read_card(find_model("starter"))
    generator = SimpleNamespace(card=card, generate=lambda request: [])
    sampling = Sampling(steps=7, guidance=2.5, sampler="ddim")
    rows = [Generated(generator, sampling, "w1", "ours"), Generated(generator, row="own")]
    made = provenance_of(rows, dataset, Reader())
    assert made.sampling["ours"] == ", ddim 7 steps, guidance 2.5"
    assert f"{card.sampling.steps} steps" in made.sampling["own"]
    assert made.weights == {"ours": "w1", "own": ""} and made.evaluator == "reader"
    assert made.data_hash == dataset.fingerprint and made.body == body_of(dataset) == ""
    assert {"latentmotion", "torch", "commit", "machine"} <= set(made.versions)
    shifted = replace(card, normalizer_mean=(1.0, *card.normalizer_mean[1:]))
    assert statistics_hash(shifted) != statistics_hash(card) == made.statistics["own"]


def prompt(frames: int) -> TestPrompt:
    clip = Clip(f"{frames}", "made up", "test", (), None, False, frames)
    return TestPrompt(TestItem(clip, 0, frames, ()), 0, frames, None)


@pytest.mark.parametrize("count", [1, 5, TIMED, TIMED + 1, 3 * TIMED + 5])
@pytest.mark.parametrize("longest_first", [False, True])
def test_timed_prompts_are_the_longest_and_others_spread_over_all(
    count: int, longest_first: bool
) -> None:
    prompts = [prompt(20 + n) for n in range(count)][:: -1 if longest_first else 1]
    timed = timed_prompts(prompts)
    assert longest_of(prompts) is timed[0] and timed[0].frames == 19 + count
    assert len(timed) == len(set(map(id, timed))) == min(count, TIMED), "each is timed once"
    assert len(set(np.diff([one.frames for one in timed[1:]]))) <= 1


@pytest.mark.parametrize("steps", [1, 2, 9])
def test_operations_of_many_steps_follow_from_two(
    steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step costs 30 operations, a frame 5."""
    asked: list[GenerationRequest] = []

    def counted(action: Callable[[], object]) -> int:
        action()
        return 30 * asked[-1].sampling.steps + 5 * asked[-1].frames[0]

    def generate(request: GenerationRequest) -> list[np.ndarray]:
        asked.append(request)
        return []

    monkeypatch.setattr(cost_file, "flops", counted)
    card = read_card(find_model("starter"))
    generator = SimpleNamespace(card=card, generate=generate)
    candidate = Generated(generator, replace(card.sampling, steps=steps))
    assert generation_flops(candidate, prompt(40)) == 30 * steps + 5 * 40
    assert [request.sampling.steps for request in asked] == [1, 2]


def test_errors_of_padding_count_for_the_authors(dataset: Dataset) -> None:
    scores = PositionScores(dataset)
    real = [dataset.features(clip) for clip in dataset.clips("val")]
    none = scores.reconstruction(real, real, None)
    assert {name: pytest.approx(0, abs=1e-6) for name in ("MPJPE", "PA-MPJPE", "ACCL")} == none
    wrong = [motion + 0.05 for motion in real]
    padding = dataset.normalizer.mean
    clean, padded = (scores.reconstruction(wrong, real, p) for p in (None, padding))
    assert padded["MPJPE"] > clean["MPJPE"] > 10
    alone = scores.reconstruction(wrong[:1], real[:1], padding)
    assert alone == scores.reconstruction(wrong[:1], real[:1], None), "nothing is padded"


def test_quality_is_a_mean_over_motions(dataset: Dataset) -> None:
    scores = PositionScores(dataset)
    real = [dataset.features(clip) for clip in dataset.clips("val")]
    each = [scores.quality([motion]) for motion in real]
    for name, value in scores.quality(real).items():
        assert value == pytest.approx(np.mean([one[name] for one in each])), name
    training = [dataset.features(clip) for clip in dataset.clips("train", mirrored=True)]
    assert scores.nearest(training)["Nearest clip"] == pytest.approx(0, abs=1e-2)
    assert scores.average_errors(real, real)["APE joints"] == 0


def test_joints_of_other_features_are_no_matter_of_bodies(dataset: Dataset) -> None:
    assert notes_on_joints(dataset, Reader()) == []
    assert not lacks_smpl_joints(dataset, Reader())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "is not an evaluator: it has no evaluator.json"),
        ("{", "is damaged"),
        ("[]", "is damaged"),
        ('{"no": 1}', "KeyError"),
        ('{"kind": "taste"}', "kind 'taste', known are text_motion, action"),
    ],
)
def test_folders_that_are_no_evaluators(tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "evaluator.json").write_text(content)
    with pytest.raises(ModelError, match=message):
        load_evaluator(tmp_path)
    if content and "kind" in content:
        assert evaluator_kind(tmp_path) == "taste"
