"""Conditions: one list of contract checks for all, then what each adds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from latentmotion.diffusion.condition import (
    ActionCondition,
    Condition,
    SentenceCondition,
    TextConditioning,
    TextEmbedding,
    Unconditional,
    stack,
)
from latentmotion.errors import InputError


class LetterEncoder:
    """Letters as words; enough to see what a condition makes of an encoder."""

    name = "letters"
    width = 2

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        return stack([self._encode(f"^{text}") for text in sentences])

    def _encode(self, text: str) -> TextEmbedding:
        words = np.array([[[ord(letter), 1.0] for letter in text]], np.float32)
        return TextEmbedding(words.mean(1), words, np.ones(words.shape[:2], dtype=bool))


BOTH = TextConditioning(words=3)
WORDS = TextConditioning(pooled=False, words=9)

CONDITIONS = {
    "both": (
        SentenceCondition(LetterEncoder(), TextConditioning(words=3)),
        ["walk", "go", "a kick"],
    ),
    "pooled": (SentenceCondition(LetterEncoder()), ["walk", "go", "a kick"]),
    "words": (SentenceCondition(LetterEncoder(), WORDS), ["walk", "go", "a kick"]),
    "action": (ActionCondition(("walk", "kick", "sit")), ["sit", "walk", "kick"]),
    "nothing": (Unconditional(5), [None, None, None]),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_order_and_company_in_the_batch_do_not_matter(name: str) -> None:
    condition: Condition = CONDITIONS[name][0]
    inputs = CONDITIONS[name][1]
    together, turned = condition(inputs), condition(inputs[::-1])
    np.testing.assert_array_equal(together.tokens, turned.tokens[::-1])
    np.testing.assert_array_equal(together.mask, turned.mask[::-1])
    for row, one in enumerate(inputs):
        alone = condition([one])
        np.testing.assert_array_equal(
            together.tokens[row][together.mask[row]], alone.tokens[0][alone.mask[0]]
        )


@pytest.mark.parametrize("name", CONDITIONS)
def test_null_has_its_rows_and_the_width_of_the_condition(name: str) -> None:
    condition, inputs = CONDITIONS[name]
    null = condition.null(4)
    assert null.tokens.shape[::2] == (4, condition(inputs).tokens.shape[2])
    assert null.mask.shape == null.tokens.shape[:2]
    np.testing.assert_array_equal(null.tokens[:1], condition.null(1).tokens)
    np.testing.assert_array_equal(null.tokens, condition.null(4).tokens)


def test_labels_are_unit_vectors_and_null_is_zero() -> None:
    condition = ActionCondition(("walk", "kick"))
    np.testing.assert_array_equal(condition(["kick", "walk"]).tokens[:, 0], [[0, 1], [1, 0]])
    assert not condition.null(2).tokens.any()
    with pytest.raises(InputError, match="did you mean 'kick'"):
        condition(["kicks"])


def test_words_are_padded_with_zeros() -> None:
    found = SentenceCondition(LetterEncoder(), WORDS)(["walk", "go"])
    assert found.mask.sum(1).tolist() == [5, 3]
    assert not found.tokens[1, 3:].any()


def test_the_pooled_sentence_comes_before_as_many_words_as_asked_for() -> None:
    encoder = LetterEncoder()
    found = SentenceCondition(encoder, TextConditioning(words=2))(["walk"])
    embedded = encoder(["walk"])
    np.testing.assert_array_equal(found.tokens[0, 0], embedded.pooled[0])
    np.testing.assert_array_equal(found.tokens[0, 1:], embedded.words[0, :2])
    with pytest.raises(InputError, match="words of at least 1"):
        TextConditioning(pooled=False)


def test_a_pooled_sentence_alone_may_be_of_another_width_than_words() -> None:
    embedded = TextEmbedding(np.ones((2, 5)), np.ones((2, 3, 4)), np.ones((2, 3), dtype=bool))
    assert TextConditioning()(embedded).tokens.shape == (2, 1, 5)
