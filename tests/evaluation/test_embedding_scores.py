"""Embeddings of a replication and the figures that they give, with evaluators of closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from latentmotion.data.clip import Caption, Clip
from latentmotion.diffusion.condition import ActionTask, TextTask, UnconditionalTask
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import InputError
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.evaluators.interface import Recognition, TextMotionEvaluator
from latentmotion.evaluation.metrics import (
    Gaussian,
    diversity,
    drawn_diversity,
    frechet_distance,
    kid,
    multimodality,
)
from latentmotion.evaluation.protocol import (
    CLEAN,
    PAPER,
    Quirks,
    Repeats,
    Replication,
    TestItem,
    TestPrompt,
)
from latentmotion.evaluation.scores import (
    EmbeddingCache,
    Embeddings,
    caption_multimodality,
    embedding_scores,
    ground_truth_scores,
    measures_multimodality,
)
from latentmotion.model.card import ModelCard, find_model, read_card


@dataclass
class Reader:
    """A text-motion evaluator of two numbers that notes what it reads."""

    width: int = 2
    fingerprint: str = "reader"
    read: list[str] = field(default_factory=list)

    def motions(self, features: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack([motion.mean(0)[:2] for motion in features])

    def texts(self, captions: Sequence[Caption]) -> np.ndarray:
        self.read += [caption.text for caption in captions]
        return np.array([[len(caption.text), caption.end_frame] for caption in captions], float)


@dataclass(frozen=True)
class Labels:
    """An action classifier that is sure of the label whose number a motion repeats."""

    labels: tuple[str, ...] = ("kick", "walk", "sit")
    fingerprint: str = "labels"

    def __call__(self, features: Sequence[np.ndarray]) -> Recognition:
        numbers = np.array([int(motion[0, 0]) for motion in features])
        return Recognition(np.stack([motion[0] for motion in features]), np.eye(3)[numbers])


def replication(captions: Sequence[str | None], actions: Sequence[str | None]) -> Replication:
    prompts = []
    for number, (text, action) in enumerate(zip(captions, actions, strict=True)):
        caption = None if text is None else Caption(text, 0, 8)
        clip = Clip(f"{number}", "made up", "test", (), action, False, 8)
        prompts.append(TestPrompt(TestItem(clip, 0, 8, ()), 0, 8, caption))
    return Replication(0, tuple(prompts), [np.full((8, 4), float(n)) for n in range(len(prompts))])


def test_captions_are_read_once() -> None:
    reader = Reader()
    cache = EmbeddingCache(reader)
    first = cache.texts(replication(["a", "bb", "a"], [None] * 3).prompts)
    np.testing.assert_array_equal(first, [[1, 8], [2, 8], [1, 8]])
    assert reader.read == ["a", "bb"]
    again = cache.embed([np.ones((8, 4))] * 2, replication(["ccc", "bb"], [None] * 2))
    np.testing.assert_array_equal(again.texts, [[3, 8], [2, 8]])
    assert reader.read == ["a", "bb", "ccc"] and again.logits is None


def test_a_prompt_without_caption_leaves_all_without() -> None:
    reader = Reader()
    assert EmbeddingCache(reader).texts(replication(["a", None], [None] * 2).prompts) is None
    assert not reader.read


def test_labels_are_numbers_of_the_classifier() -> None:
    cache = EmbeddingCache(Labels())
    asked = replication([None] * 4, ["sit", "kick", "sit", "walk"])
    motions = [np.full((8, 4), float(n)) for n in (2, 0, 1, 1)]
    found = cache.embed(motions, asked)
    assert found.labels is not None and found.labels.tolist() == [2, 0, 2, 1]
    np.testing.assert_array_equal(found.motions, cache.motions(motions))
    assert found.texts is None is cache.texts(asked.prompts)
    assert embedding_scores(found, found, True, CLEAN, 0)["Accuracy"] == 0.75


def test_unlabelled_and_unknown_prompts() -> None:
    cache = EmbeddingCache(Labels())
    motions = [np.zeros((8, 4))] * 2
    assert cache.embed(motions, replication([None] * 2, ["sit", None])).labels is None
    with pytest.raises(InputError, match=r"label 'fly', only kick, walk, sit; take one that was"):
        cache.embed(motions, replication([None] * 2, ["sit", "fly"]))


def test_evaluators_are_told_apart_by_what_they_do() -> None:
    assert isinstance(Reader(), TextMotionEvaluator)
    assert not isinstance(Labels(), TextMotionEvaluator)


@pytest.fixture
def real() -> Embeddings:
    random = np.random.default_rng(5)
    labels = np.arange(40) % 3
    motions = random.standard_normal((40, 4)) + labels[:, None]
    return Embeddings(motions, np.eye(3)[labels], labels, motions + 0.01)


def test_figures_of_a_candidate_are_the_metrics(real: Embeddings) -> None:
    made = replace(real, motions=real.motions[::-1] + 0.5)
    scores = embedding_scores(made, real, True, CLEAN, 0)
    gaussians = Gaussian.of(made.motions), Gaussian.of(real.motions)
    assert scores["FID"] == pytest.approx(frechet_distance(*gaussians))
    assert scores["KID"] == pytest.approx(kid(made.motions, real.motions, paired=True))
    assert scores["Diversity"] == pytest.approx(diversity(made.motions))
    assert real.labels is not None
    groups = [made.motions[real.labels == label] for label in range(3)]
    assert scores["MultiModality"] == pytest.approx(multimodality(groups))
    unprompted = embedding_scores(made, real, False, CLEAN, 0)
    assert unprompted == {name: scores[name] for name in ("Diversity", "FID", "KID")}


def test_who_matches_every_caption_is_first_in_every_group(real: Embeddings) -> None:
    scores = ground_truth_scores(real, CLEAN, 0)
    assert scores["R@1"] == scores["R@3"] == 1
    assert scores["MM-Dist"] == pytest.approx(0.02)
    assert scores["FID"] > 0.01, "of two halves"
    whole = replace(CLEAN, quirks=Quirks(permuted_truth=True))
    assert ground_truth_scores(real, whole, 0)["FID"] == pytest.approx(0, abs=1e-6)


def test_two_motions_are_too_few_for_halves() -> None:
    pair = Embeddings(np.array([[0.0, 1.0], [2.0, 0.0]]))
    assert ground_truth_scores(pair, CLEAN, 0)["FID"] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("protocol", [CLEAN, PAPER])
def test_draws_depend_on_seed_and_replication(real: Embeddings, protocol) -> None:
    first, same = (ground_truth_scores(real, protocol, 4) for _ in range(2))
    other = ground_truth_scores(real, protocol, 5)
    assert first == same
    assert first["KID"] != other["KID"]
    assert (first["Diversity"] == other["Diversity"]) == (protocol is CLEAN)


@pytest.mark.parametrize(("real_ones", "pairs"), [(True, 200), (False, 300)])
def test_the_authors_draw_fewer_pairs_of_real_motions(
    real: Embeddings, real_ones: bool, pairs: int
) -> None:
    one, other = PAPER.generator("diversity", 4).integers(40, size=(2, pairs))
    if real_ones:
        scores = ground_truth_scores(real, PAPER, 4)
    else:
        scores = embedding_scores(real, real, False, PAPER, 4)
    assert scores["Diversity"] == drawn_diversity(real.motions, one, other)


def test_the_authors_drop_what_fills_no_group(real: Embeddings) -> None:
    assert real.texts is not None
    texts = real.texts.copy()
    dropped = replace(CLEAN, quirks=Quirks(remainder_dropped=True))
    order = dropped.generator("groups", 0).permutation(40)
    texts[order[32:]] += 1000
    scores = [
        ground_truth_scores(replace(real, texts=texts), protocol, 0)["R@1"]
        for protocol in (dropped, CLEAN)
    ]
    assert scores[0] == 1 > scores[1]


def card(task: TextTask | ActionTask | UnconditionalTask) -> ModelCard:
    return replace(read_card(find_model("starter")), condition=task)


@pytest.mark.parametrize(
    ("task", "repeats", "number", "expected"),
    [
        (TextTask(), Repeats(4, 3, None, 2), 1, True),
        (TextTask(), Repeats(4, 3, None, 2), 2, False),
        (TextTask(), Repeats(0, 3, None, 2), 0, False),
        (TextTask(), Repeats(4, 1, None, 2), 0, False),
        (ActionTask(("kick",)), Repeats(4, 3, None, 2), 0, False),
        (UnconditionalTask(), Repeats(4, 3, None, 2), 0, False),
    ],
)
def test_when_many_motions_of_a_caption_are_made(task, repeats, number, expected) -> None:
    generator = SimpleNamespace(card=card(task), generate=lambda request: [])
    protocol = replace(CLEAN, repeats=repeats)
    assert measures_multimodality(Generated(generator), protocol, number) is expected


@pytest.mark.parametrize("pairs", [None, 2])
def test_motions_of_a_caption_are_compared_with_each_other(pairs: int | None) -> None:
    """Each motion is its caption's number with a spread of ±1, whatever the caption."""
    asked: list[str] = []

    def generate(request: GenerationRequest) -> list[np.ndarray]:
        asked.extend(request.prompts)
        assert len(set(request.seeds)) == len(request.seeds)
        signs = [(-1) ** number for number in range(len(request.prompts))]
        return [
            np.full((8, 4), 100.0 * len(text) + sign)
            for text, sign in zip(request.prompts, signs, strict=True)
        ]

    candidate = Generated(SimpleNamespace(card=card(TextTask()), generate=generate))
    protocol = replace(CLEAN, repeats=Repeats(3, 2, pairs))
    found = caption_multimodality(
        candidate, replication(list("abcdef"), [None] * 6), EmbeddingCache(Reader()), protocol
    )
    assert len(asked) == 6 and all(asked.count(text) == 2 for text in asked)
    assert found in ((0.0, 2 * 2**0.5) if pairs else (2 * 2**0.5,))
