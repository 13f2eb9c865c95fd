from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.engine.encoder import StudentTextEncoder
from latentmotion.errors import ModelError
from latentmotion.evaluation.evaluators.interface import TextMotionEvaluator, load_evaluator
from latentmotion.evaluation.evaluators.text_motion import (
    T2MEvaluator,
    TextMotionCard,
    export_scorer,
    load_text_motion,
    save_text_motion,
)
from latentmotion.evaluation.evaluators.text_motion_network import TextMotionConfig, TowerConfig
from latentmotion.evaluation.evaluators.words import EncodedWords
from latentmotion.model.card import find_model
from latentmotion.ranking.scorer import Scorer
from latentmotion.ranking.search import read_training_vectors

TINY = TowerConfig(hidden=24, motion_layers=1, text_layers=1, heads=2, width=12)


@pytest.fixture(scope="module")
def evaluator(figures: Path) -> T2MEvaluator:
    torch.manual_seed(0)
    encoder = StudentTextEncoder.load(find_model("starter"))
    card = TextMotionCard("tiny", "humanml3d", TINY, encoder.name)
    normalizer = Dataset.load(figures).normalizer
    return T2MEvaluator(card, TINY.build().eval(), normalizer, EncodedWords(encoder))


@torch.no_grad()
def test_padding_changes_nothing(evaluator: T2MEvaluator) -> None:
    features, mask = torch.randn(2, 40, 263), torch.ones(2, 40, dtype=torch.bool)
    features[1, 24:], mask[1, 24:] = 0, False
    together = evaluator.networks.motions(features, mask)
    alone = evaluator.networks.motions(features[1:, :24], mask[1:, :24])
    assert float((together[1] - alone[0]).abs().max()) < 1e-5
    assert together.norm(dim=1).tolist() == pytest.approx([1.0, 1.0])


@torch.no_grad()
def test_rotations_and_contacts_are_not_read(evaluator: T2MEvaluator) -> None:
    features, mask = torch.randn(1, 16, 263), torch.ones(1, 16, dtype=torch.bool)
    other = features.clone()
    other[..., 67:193], other[..., -4:] = 7, 7
    vectors = [evaluator.networks.motions(each, mask) for each in (features, other)]
    assert torch.equal(vectors[0], vectors[1])


def test_an_evaluator_folder_keeps_towers(evaluator: T2MEvaluator, tmp_path: Path) -> None:
    save_text_motion(tmp_path / "kept", evaluator, find_model("starter"))
    assert load_text_motion(tmp_path / "kept").fingerprint == evaluator.fingerprint


def test_the_exported_scorer_repeats_the_networks(
    evaluator: T2MEvaluator, figures: Path, tmp_path: Path
) -> None:
    data = Dataset.load(figures)
    export_scorer(evaluator, tmp_path / "scorer", data, "mine")
    scorer = Scorer.load(tmp_path / "scorer")
    assert (scorer.card.name, scorer.card.fingerprint) == ("mine", evaluator.fingerprint)
    features = [data.features(clip) for clip in data.clips("train")[:3]]
    # Matrices are kept in 8 bits.
    assert np.abs(scorer.embed(features) - evaluator.motions(features)).max() < 1e-2
    texts = ["a person walks", "kick twice with the left foot"]
    found = evaluator.texts([Caption(text, 0, 1) for text in texts])
    assert np.abs(scorer.texts(texts) - found).max() < 1e-2
    judge = load_evaluator(tmp_path / "scorer")
    assert isinstance(judge, TextMotionEvaluator) and judge.fingerprint == evaluator.fingerprint
    assert np.array_equal(judge.motions(features), scorer.embed(features))
    assert np.array_equal(judge.texts([Caption(text, 0, 1) for text in texts]), scorer.texts(texts))
    assert len(read_training_vectors(scorer).clips) == len(data.clips("train"))
    graph = onnx.load(tmp_path / "scorer" / "motion.onnx")
    packed = [t for t in graph.graph.initializer if t.data_type == onnx.TensorProto.INT8]
    assert len(packed) > 4


def test_the_shipped_scorer_is_an_evaluator_by_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    judge = load_evaluator(Path("scorer"))
    assert isinstance(judge, TextMotionEvaluator)
    assert judge.width == 128 and len(judge.fingerprint) == 64


def test_other_evaluators_are_refused(evaluator: T2MEvaluator, tmp_path: Path) -> None:
    networks = TextMotionConfig(263, 4, 384, 8, 6, 6, 5).build()
    with pytest.raises(ModelError, match="--preset scorer"):
        export_scorer(replace(evaluator, networks=networks), tmp_path / "scorer")
