from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.cli.main import main
from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TextEmbedding
from latentmotion.errors import DataError, InputError
from latentmotion.evaluation.evaluators.interface import load_evaluator
from latentmotion.evaluation.evaluators.text_motion import T2MEvaluator
from latentmotion.evaluation.evaluators.text_motion_network import (
    InfoNCE,
    Margin,
    squared_distances,
    top_hits,
)
from latentmotion.evaluation.evaluators.words import EncodedWords
from latentmotion.training.evaluator import (
    EvaluatorExperiment,
    EvaluatorStage,
    fit_to,
    recipe_named,
    train_evaluator,
)
from latentmotion.training.experiment import with_changes
from latentmotion.training.run_folder import read_journal
from tests.support.evaluator_files import write_glove
from tests.support.small_training import CONTEXT

WORDS = ["sos", "eos", "unk", "a", "person", "sway", "left", "right"]

SMALLER = {
    "networks.movement_width": 8,
    "networks.motion_hidden": 8,
    "networks.text_hidden": 8,
    "networks.width": 6,
    "training.steps": 6,
    "training.batch_size": 4,
    "training.report_every": 1,
    "training.validate_every": 3,
    "training.snapshot_every": 2,
}


def tiny(**changes: object) -> EvaluatorExperiment:
    every = {**SMALLER, **changes}
    return with_changes(recipe_named("small"), [f"{k}={json.dumps(v)}" for k, v in every.items()])


@dataclass(frozen=True)
class Letters:
    """A text encoder whose words are letters."""

    name: str = "letters"
    width: int = 5

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        mask = np.arange(24) < np.array([max(len(s), 1) for s in sentences])[:, None]
        words = np.zeros((*mask.shape, 5), np.float32)
        for row, sentence in zip(words, sentences, strict=True):
            for place, letter in enumerate(sentence[:24]):
                row[place, ord(letter) % 5] = 1
        return TextEmbedding(words.mean(1), words, mask)


LETTERS = EncodedWords(Letters())


def weights(run: Path) -> bytes:
    return (run / "model" / "weights.safetensors").read_bytes()


def test_an_evaluator_is_trained_with_word_vectors(figures: Path, tmp_path: Path) -> None:
    glove = write_glove(tmp_path / "glove", WORDS)
    changes = [f"--set={key}={value}" for key, value in SMALLER.items()]
    command = f"train evaluator --data {figures} --glove {glove} --preset small -o {tmp_path}/run"
    main([*command.split(), *changes, "--device", "cpu"])
    found = load_evaluator(tmp_path / "run" / "model")
    assert isinstance(found, T2MEvaluator)
    assert found.card.vocabulary == tuple(WORDS)
    assert found.card.provenance.license == "CC0-1.0"
    names = ("loss", "top_1", "top_2", "top_3", "sides")
    assert set(found.card.figures) == {f"val_{name}" for name in names}
    dataset = Dataset.load(figures)
    assert np.array_equal(found.normalizer.std, dataset.normalizer.std)
    (clip, *_) = dataset.clips("val")
    assert found.motions([dataset.features(clip)]).shape == (1, 6)
    assert found.texts(clip.captions).shape == (1, 6)


def test_the_starter_reads_words_and_travels_along(figures: Path, tmp_path: Path) -> None:
    changes = [f"--set={key}={value}" for key, value in {**SMALLER, "training.steps": 1}.items()]
    command = f"train evaluator --data {figures} --preset small -o {tmp_path}/run --device cpu"
    main([*command.split(), *changes])
    found = load_evaluator(tmp_path / "run" / "model")
    assert isinstance(found, T2MEvaluator)
    captions = [Caption(text, 0, 1) for text in ("a person walks", "jumping", "a person walks")]
    together = found.texts(captions)
    assert np.abs(together[0] - together[2]).max() < 1e-6
    assert np.abs(together[1] - found.texts(captions[1:2])[0]).max() < 1e-5
    (tmp_path / "run" / "model" / "text_encoder.onnx").unlink()
    with pytest.raises(Exception, match="lacks its text encoder"):
        load_evaluator(tmp_path / "run" / "model")


def test_an_interrupted_run_goes_on_bit_for_bit(
    figures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(name: str) -> None:
        train_evaluator(tiny(), figures, LETTERS, tmp_path / name, CONTEXT)

    def stop_at_four(stage: EvaluatorStage, step: int) -> dict[str, torch.Tensor]:
        if step == 4:
            raise KeyboardInterrupt
        return forward(stage, step)

    forward = EvaluatorStage.forward
    monkeypatch.setattr(EvaluatorStage, "forward", stop_at_four)
    with pytest.raises(KeyboardInterrupt):
        run("twice")
    assert not (tmp_path / "twice" / "model").exists()
    monkeypatch.undo()
    run("twice")
    run("once")
    assert read_journal(tmp_path / "once")[-1]["step"] == 6
    assert weights(tmp_path / "once") == weights(tmp_path / "twice")


def test_another_configuration_is_refused(figures: Path, tmp_path: Path) -> None:
    train_evaluator(tiny(**{"training.steps": 1}), figures, LETTERS, tmp_path / "run", CONTEXT)
    other = tiny(**{"training.steps": 1, "networks.width": 7})
    with pytest.raises(InputError, match=r"networks.width \(6 → 7\)"):
        train_evaluator(other, figures, LETTERS, tmp_path / "run", CONTEXT)


def test_it_learns_which_sentence_tells_of_which_motion(figures: Path, tmp_path: Path) -> None:
    changes = {
        "objective.temperature": 1,
        "networks.dropout": 0.0,
        "training.steps": 40,
        "training.batch_size": 10,
        "training.learning_rate": 0.01,
        "training.warm_up": 1,
        "mirrored": False,
    }
    experiment = tiny(**changes)
    train_evaluator(experiment, figures, LETTERS, tmp_path / "run", CONTEXT)
    losses = [line["total"] for line in read_journal(tmp_path / "run") if line["kind"] == "train"]
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:5])


def test_sizes_follow_data_and_words(figures: Path) -> None:
    fitted = fit_to(recipe_named("t2m").networks, Dataset.load(figures), LETTERS)
    assert (fitted.features, fitted.left_out, fitted.word_width) == (263, 4, 5)


def test_crops_of_both_lengths_take_turns(figures: Path) -> None:
    experiment = tiny(longest=[16, 64])
    dataset = Dataset.load(figures)
    experiment = replace(experiment, networks=fit_to(experiment.networks, dataset, LETTERS))
    stage = EvaluatorStage(experiment.networks.build(), LETTERS, dataset, experiment, CONTEXT)
    short, long = stage._batch_samplers[0](0), stage._batch_samplers[1](0)
    assert max(crop.frames for crop in short) <= 16 < max(crop.frames for crop in long)


def test_a_scorer_is_trained_with_hard_negatives(figures: Path, tmp_path: Path) -> None:
    changes = {"hidden": 16, "motion_layers": 1, "text_layers": 1, "heads": 2, "width": 8}
    settings = {f"networks.{key}": value for key, value in changes.items()}
    settings |= {key: value for key, value in SMALLER.items() if key.startswith("training")}
    experiment = with_changes(
        recipe_named("scorer"), [f"{key}={value}" for key, value in settings.items()]
    )
    folder = train_evaluator(experiment, figures, LETTERS, tmp_path / "run", CONTEXT)
    assert folder.is_dir() and len(read_journal(tmp_path / "run")) == 8


def test_data_without_captions_is_refused(figures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = Dataset.load(figures)
    monkeypatch.setattr(Dataset, "clips", lambda *_, **__: [])
    with pytest.raises(DataError, match="no captioned clip"):
        EvaluatorStage(tiny().networks.build(), LETTERS, dataset, tiny(), CONTEXT)


def test_mistakes_on_the_command_line(figures: Path, tmp_path: Path) -> None:
    command = f"train evaluator --data {figures} -o {tmp_path}/run"
    for rest in ("--preset smal", "--glove x --text-encoder starter", "--set networks.wdth=3"):
        with pytest.raises(SystemExit) as stop:
            main([*command.split(), *rest.split()])
        assert stop.value.code == 2
    assert not (tmp_path / "run").exists()
    with pytest.raises(InputError, match="did you mean 'small'"):
        recipe_named("smal")


def test_infonce_of_equal_distances_is_the_logarithm_of_the_batch() -> None:
    told = torch.eye(8, dtype=torch.bool)
    assert float(InfoNCE()(torch.ones(8, 8), told)) == pytest.approx(np.log(8), rel=1e-6)


def test_a_sentence_that_tells_of_two_motions_is_no_contrast() -> None:
    squared = torch.tensor([[1.0, 0.0], [9.0, 1.0]])
    told = torch.tensor([[True, True], [True, True]])
    assert float(InfoNCE()(squared, told)) == pytest.approx(0.0, abs=1e-6)
    assert float(Margin(3.0)(squared, told)) == pytest.approx(1.0)


def test_margin_in_closed_form() -> None:
    squared = torch.tensor([[1.0, 4.0], [25.0, 0.0]])
    told = torch.eye(2, dtype=torch.bool)
    # Pairs: 1 and 0. Others: distance 2 lies 1 inside the margin, distance 5 beyond.
    assert float(Margin(3.0)(squared, told)) == pytest.approx((1 + 1 + 0 + 0) / 2)


def test_slopes_are_finite_at_distance_zero() -> None:
    texts = torch.zeros(3, 2, requires_grad=True)
    for objective in (InfoNCE(), Margin()):
        squared = squared_distances(texts, torch.zeros(3, 2))
        objective(squared, torch.eye(3, dtype=torch.bool)).backward()
        assert texts.grad is not None and bool(torch.isfinite(texts.grad).all())


def test_hits_count_any_motion_that_is_told_of() -> None:
    squared = torch.tensor([[3.0, 1.0, 2.0], [0.0, 1.0, 2.0], [1.0, 2.0, 3.0]])
    told = torch.tensor([[True, True, False], [False, True, False], [False, False, True]])
    assert top_hits(squared, told) == pytest.approx([1 / 3, 2 / 3, 1.0])
