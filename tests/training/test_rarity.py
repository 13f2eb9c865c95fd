"""Draws by rarity: weights by support, the share of composed sequences, and draws that follow."""

from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Cropping, Dataset, Item, plan_epoch
from latentmotion.data.store import COMPOSED
from latentmotion.model.config import FewStepConfig
from latentmotion.networks.checkpoint import load_model
from latentmotion.training.distillation.data import TrajectoryRegression, prepare_distillation
from latentmotion.training.experiment import RarityDraws, with_changes
from latentmotion.training.stages import train_denoiser
from tests.support.small_training import CONTEXT, LetterCount, short_distillation, small

DIRECTIONS = {"walk": [1.0, 0, 0], "sweep": [0, 1.0, 0], "both": [0.6, 0.6, 0.5]}


def items(counts, source="cmu"):
    return [
        Item(Clip(f"{text}{n}", source, "train", (), None, False, 40), 0, 40, (text,))
        for text, count in counts.items()
        for n in range(count)
    ]


def embed(texts):
    return np.array([DIRECTIONS[text] for text in texts])


def test_sentences_of_few_clips_weigh_more_up_to_a_limit():
    weighed = RarityDraws(power=0.5, usual=8, most=2.5).weigh(
        items({"walk": 32, "sweep": 1}), embed
    )
    weights = {item.captions[0]: item.weight for item in weighed}
    assert weights == {"walk": pytest.approx(0.5), "sweep": pytest.approx(2.5)}


def test_no_power_leaves_items_alone():
    plain = items({"walk": 2})
    assert RarityDraws().weigh(plain, embed) == plain


def test_composed_sequences_are_no_more_than_their_share():
    every = [*items({"walk": 9}), *items({"both": 50}, COMPOSED)]
    weighed = RarityDraws(power=1.0, composed=0.25).weigh(every, embed)
    composed = sum(item.weight for item in weighed if item.clip.source == COMPOSED)
    assert composed == pytest.approx(0.25 * sum(item.weight for item in weighed))


def test_draws_follow_the_weights():
    weighed = RarityDraws(power=1.0, usual=1, most=1).weigh(items({"walk": 30, "sweep": 1}), embed)
    drawn = [
        crop.caption
        for epoch in range(40)
        for batch in plan_epoch(weighed, 31, Cropping(min_frames=8), 0, epoch)
        for crop in batch
    ]
    assert drawn.count("sweep") / len(drawn) == pytest.approx(0.5, abs=0.06)


def test_captions_of_an_item_are_drawn_by_their_weights():
    clip = Clip("a", "cmu", "train", (), None, False, 40)
    item = Item(clip, 0, 40, ("walk", "sweep"), (1.0, 3.0))
    generator = np.random.default_rng(0)
    drawn = [item.draw_caption(generator) for _ in range(2000)]
    assert drawn.count("sweep") / 2000 == pytest.approx(0.75, abs=0.04) and item.weight == 3.0


def test_a_teacher_is_asked_captions_by_their_weights(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    encoder, dataset = LetterCount(), Dataset.load(figures)
    model = load_model(train_denoiser(small(), figures, vae_run, encoder, tmp_path, CONTEXT))
    plain = short_distillation(FewStepConfig(), TrajectoryRegression(64))
    rare = with_changes(plain, ["draws.power=0.6"])
    before, after = (
        prepare_distillation(settings, dataset, model, encoder, tmp_path, CONTEXT).items
        for settings in (plain, rare)
    )
    assert {item.weights for item in before} == {()}
    assert list(after) == rare.draws.weigh(before, lambda texts: encoder(texts).pooled)
