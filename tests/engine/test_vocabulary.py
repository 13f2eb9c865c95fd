"""Captions, their variations, and the tokenizer cut down to them."""

from __future__ import annotations

import json
import lzma
import random
from pathlib import Path

import numpy as np
import pytest

from latentmotion.engine.encoder import split_words
from latentmotion.errors import DataError
from latentmotion.training.text_encoder import (
    frequent_words,
    is_held_out,
    parse_line,
    pieces_to_keep,
    places_in,
    plain_phrases,
    read_captions,
    restrict,
    vary,
)
from tests.support.tiny_text import CAPTIONS, teacher_tokenizer

LINE = "A man kicks.#a/DET man/NOUN kick/VERB#0.0#0.0"


def test_caption_lines_are_read_with_their_tags() -> None:
    caption = parse_line(LINE)
    assert caption.text == "a man kicks."
    assert caption.tags == (("a", "DET"), ("man", "NOUN"), ("kick", "VERB"))


def test_captions_come_from_a_folder_or_a_json_file_each_text_once(tmp_path: Path) -> None:
    (tmp_path / "000001.txt").write_text(f"{LINE}\n{LINE}\n\n", encoding="utf-8")
    packed = tmp_path / "texts.json.xz"
    with lzma.open(packed, "wt") as file:
        json.dump({"000001": LINE, "000002": "she waves#she/PRON wave/VERB#0.0#0.0"}, file)
    assert [caption.text for caption in read_captions(tmp_path)] == ["a man kicks."]
    assert [caption.text for caption in read_captions(packed)] == ["a man kicks.", "she waves"]


def test_missing_or_empty_captions_are_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        read_captions(tmp_path / "nowhere.json")
    with pytest.raises(DataError, match="no captions"):
        read_captions(tmp_path)


def test_mirrored_captions_are_held_out_together() -> None:
    pairs = [(f"{n} steps left", f"{n} steps right") for n in range(300)]
    assert all(is_held_out(one) == is_held_out(other) for one, other in pairs)
    assert 0.01 < np.mean([is_held_out(one) for one, _ in pairs]) < 0.12


def test_variations_repeat_with_their_seed() -> None:
    caption = parse_line(LINE)
    varied = [[vary(caption, ["dog"], random.Random(seed)) for seed in range(50)] for _ in "ab"]
    assert varied[0] == varied[1]
    assert len(set(varied[0])) > 10


def test_plain_phrases_hold_what_users_type() -> None:
    phrases = plain_phrases([parse_line(LINE)], ["dog"], random.Random(0))
    assert {"kick", "a person kicks", "dance ballet", "dog"} <= set(phrases)


def test_restricted_tokenizer_cuts_kept_sentences_like_the_large_one() -> None:
    large = teacher_tokenizer()
    small = restrict(large, pieces_to_keep(large, CAPTIONS, words=2, continuations=1), 16)
    assert small.get_vocab_size() < large.get_vocab_size()
    for caption in CAPTIONS:
        assert small.encode(caption).tokens == large.encode(caption).tokens
    names = sorted(small.get_vocab(), key=small.get_vocab().__getitem__)
    back = {place: piece for piece, place in large.get_vocab().items()}
    assert [back[place] for place in places_in(large, small)] == names
    assert len(small.encode("walk " * 99).ids) == 16


def test_frequent_words_are_whole_and_in_order() -> None:
    assert frequent_words(teacher_tokenizer(), 3) == ["person", "walks", "kicks"]


def test_split_words_are_named_as_written() -> None:
    tokenizer = teacher_tokenizer()
    assert split_words(tokenizer, "a person walks") == []
    assert split_words(tokenizer, "person Kab walks 猫") == ["kab", "猫"]
