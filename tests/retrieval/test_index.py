"""The index of clips: support of sentences, files, joining, and what was left out of training."""

import json
import lzma
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load, save

import latentmotion.data
from latentmotion.data.clip import Source
from latentmotion.errors import InputError, ModelError
from latentmotion.language.words import words_of
from latentmotion.model.card import MOVES_FILE, SHIPPED
from latentmotion.retrieval.index import (
    ALL_DIRECTIONS,
    DRAWN,
    ClipIndex,
    IndexedCaption,
    IndexedClip,
    SentenceClassifier,
    index_file,
    quantized,
    read_index,
)
from latentmotion.retrieval.starts import LONGEST_STRETCH, stretched
from latentmotion.retrieval.teach import SAME_OF_CLIP, support, thinned
from latentmotion.retrieval.wordings import read_wordings

OWNER = Source("ours", "CC0", "us")


def index_of(captions, vectors, tokens=(4, 6), support=1, owner=OWNER, wordings=(), directions=()):
    """An index of clips of these lengths with captions (text, clip), and numbers of wordings."""
    starts = np.cumsum([0, *tokens])
    latents = np.random.default_rng(0).standard_normal((starts[-1], 3)).astype(np.float32)
    codes, scale = quantized(latents, 0, 127)
    return ClipIndex(
        "encoder",
        "space",
        (owner,),
        tuple(
            IndexedClip(f"clip{n}", owner.name, f"take{n}", int(starts[n]), count)
            for n, count in enumerate(tokens)
        ),
        tuple(IndexedCaption(text, clip, 0, tokens[clip], support) for text, clip in captions),
        codes,
        scale,
        np.array(wordings, np.int32),
        quantized(np.array(vectors, np.float32), 1, 127)[0],
        np.array(directions, np.float32) if directions else ALL_DIRECTIONS,
        {word: 1 for text, _ in captions for word in words_of(text)},
    )


def test_an_index_of_the_format_before_is_read(tmp_path):
    index, file = index_of([("waves", 0), ("bows", 1)], [[1, 0], [0, 1]]), tmp_path / MOVES_FILE
    index.write(file)
    arrays = load(zlib.decompress(file.read_bytes()))
    text = json.loads(arrays.pop("text").tobytes())
    text |= {name: [*zip(*text[name], strict=True)] for name in ("clips", "captions")}
    text["format"] = "latentmotion moves 1"
    arrays |= {name: np.ascontiguousarray(arrays[name].T) for name in ("latents", "embeddings")}
    arrays["text"] = np.frombuffer(json.dumps(text).encode(), np.uint8)
    file.write_bytes(zlib.compress(save(arrays)))
    before = read_index(file)
    assert before.clips == index.clips and before.captions == index.captions
    assert np.array_equal(before.latents, index.latents)
    assert np.array_equal(before.embeddings, index.embeddings)


def test_support_counts_clips_with_a_near_caption_once_each():
    captions = np.array([[1, 0], [0.99, 0.141], [0, 1]], np.float32)
    clips = [[0, 1], [1], [2]]
    assert support(captions, captions, clips).tolist() == [2, 2, 1]
    assert support(captions[:1], captions, []).tolist() == [0]


def test_an_index_is_read_as_it_was_written(tmp_path):
    index = index_of([("a wave", 0), ("a bow", 1)], [[1, 0], [0, 1]])
    index.write(tmp_path / MOVES_FILE)
    again = read_index(index_file(tmp_path))
    assert again.clips == index.clips and again.captions == index.captions
    assert again.sources == index.sources and again.words == index.words
    np.testing.assert_array_equal(again.latents, index.latents)
    (near,) = again.nearest(np.array([[0.1, 1.0]]), 1)
    assert near.caption.text == "a bow" and not near.mirrored
    assert again.about(near)["license"] == "CC0" and again.about(near)["origin"] == "take1"


def test_a_sentence_that_is_near_with_sides_swapped_is_of_the_mirror_image():
    index = index_of([("left", 0), ("up", 1)], [[1, 0, 0], [0, 0, 1]])
    (near,) = index.nearest(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), 1)
    assert near.caption.text == "left" and near.mirrored


def test_joined_indexes_keep_latents_owners_and_captions():
    one = index_of([("a wave", 0)], [[1, 0]])
    other = index_of([("a bow", 1)], [[0, 1]], owner=Source("ours", "MIT", "them"))
    both = one.joined(other)
    (near,) = both.nearest(np.array([[0.0, 1.0]]), 1)
    assert both.about(near)["credit"] == "them" and both.about(near)["license"] == "MIT"
    expected = other.latents_of(other.captions[0])
    np.testing.assert_allclose(
        both.latents_of(near.caption), expected, atol=both.latent_scale.max()
    )


def test_a_caption_is_near_by_its_wordings_too(tmp_path):
    index_of(
        [("shoots a bow", 0), ("a bow", 1)], [[1, 0], [0, 1], [0.6, -0.8]], wordings=[0]
    ).write(tmp_path / MOVES_FILE)
    index = read_index(tmp_path / MOVES_FILE)
    archery = np.array([[0.55, -0.8]], np.float32)
    near = index.nearest_by_wording(archery)
    assert near.caption.text == "shoots a bow" and near.cosine > 0.99
    (literal,) = index.nearest(archery, 1)
    assert literal.cosine < 0.6
    with pytest.raises(InputError, match="do not fit"):
        replace(index, wordings=np.array([2], np.int32))


def test_a_wording_of_a_recording_has_to_be_clearly_nearer_than_one_of_a_drawn_clip():
    vectors = [[1, 0, 0], [0, 1, 0], [0.8, 0, 0.6], [0, 0.8, 0.6]]
    index = index_of([("shoots a bow", 0), ("a bow", 1)], vectors, wordings=[0, 1])
    captions = [replace(c, support=s) for c, s in zip(index.captions, (3, DRAWN), strict=True)]
    index = replace(index, captions=tuple(captions))
    for sentence, text in (([0.82, 0.8, 0.6], "a bow"), ([0.92, 0.8, 0.6], "shoots a bow")):
        near = index.nearest_by_wording(np.array([sentence], np.float32))
        assert near.caption.text == text
    assert index.support(np.array([[0.8, 0.79, 0]])) == 3
    assert index.support(np.array([[0.8, 0.79, 0]]), margin=0.1) == DRAWN


def test_classifiers_of_sentences_are_written_and_joined(tmp_path):
    index = index_of([("a wave", 0), ("a bow", 1)], [[1, 0], [0, 1]])
    matrices = np.array([[1.0, 0.5], [0, 1]], np.float32), 9 * np.eye(2, dtype=np.float32)
    classifier = SentenceClassifier(
        *matrices, np.array([0, 0.5], np.float32), np.array([1, 0], np.int32)
    )
    assert index.outside_kind(np.array([[1.0, 0]])) == (-1, 0)
    outside = replace(classifier, labels=np.array([-1, 3], np.int32))
    index = replace(index, classifier=classifier, outside=outside)
    index.write(tmp_path / MOVES_FILE)
    again = read_index(tmp_path / MOVES_FILE)
    for sentence in ([[1.0, 0]], [[0.1, 1]]):
        expected, named = index.classified(np.array(sentence)), again.classified(np.array(sentence))
        assert named.caption == expected.caption
        assert named.probability == pytest.approx(expected.probability, abs=0.03)
    assert index.classified(np.array([[1.0, 0]])).caption.text == "a bow"
    swapped = index.classified(np.array([[0.7, 0.72], [1.0, 0]]))
    assert swapped.mirrored and swapped.caption.text == "a bow"
    taught = index_of([("a kick", 0)], [[0.5, 0.5]], support=0)
    assert taught.classified(np.array([[1.0, 0]])) is None
    for both in (taught.joined(index), index.joined(taught)):
        assert both.classified(np.array([[1.0, 0]])).caption.text == "a bow"
        assert both.outside is outside
    for sentence, probable in (([[1.0, 0]], False), ([[0, 1.0]], True)):
        kind, probability = again.outside_kind(np.array(sentence))
        assert (kind, probability > 0.5) == (3, probable)
    wrong = [("classifier", [1, 2]), ("classifier", [-1, 0]), ("outside", [-2, 0])]
    for name, labels in [*wrong, ("outside", [0, 60])]:
        with pytest.raises(InputError, match="do not fit"):
            replace(index, **{name: replace(classifier, labels=np.array(labels, np.int32))})


def test_an_index_along_few_directions_is_joined_with_one_along_all():
    shipped = index_of([("a wave", 0)], [[1], [1]], wordings=[0], directions=[[0.0], [1], [0]])
    taught = index_of([("a bow", 1)], [[0.1, 0, 1.0]], support=0)
    for index in (taught.joined(shipped), shipped.joined(taught)):
        assert index.directions.shape == (3, 1) and len(index.embeddings) == 3
        (near,) = index.nearest(np.array([[0.0, 0.3, 0.1]]), 1)
        assert near.caption.text == "a wave"
        assert index.captions[index.wordings[0]].text == "a wave"
    with pytest.raises(InputError, match="different directions"):
        shipped.joined(index_of([("a bow", 1)], [[1]], directions=[[1.0], [0], [0]]))


def test_wordings_are_read_and_damaged_lines_told(tmp_path):
    path = tmp_path / "wordings.tsv.xz"
    path.write_bytes(lzma.compress(b"# comment\na man walks\tstroll|amble\n"))
    plain = tmp_path / "wordings.tsv"
    plain.write_text("a man walks\tgo on foot\n")
    assert read_wordings([path, plain]) == {"a man walks": ["stroll", "amble", "go on foot"]}
    plain.write_text("a man walks, stroll\n")
    with pytest.raises(InputError, match="expected a caption, a tab"):
        read_wordings([plain])
    with pytest.raises(InputError, match="cannot be read as wordings"):
        read_wordings([tmp_path / "none.tsv"])


@pytest.mark.parametrize("damage", ["cut", "none", "other", "outside"])
def test_damaged_files_are_refused(tmp_path, damage):
    path = tmp_path / MOVES_FILE
    index = index_of([("a wave", 0)], [[1, 0]])
    if damage != "none":
        index.write(path)
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:-40])
    changes = {"other": (b"moves 4", b"moves 9"), "outside": (b"],[0,4],[4,6]", b"],[9,4],[4,6]")}
    if damage in changes:
        content = zlib.decompress(path.read_bytes())
        assert changes[damage][0] in content
        path.write_bytes(zlib.compress(content.replace(*changes[damage])))
    with pytest.raises(ModelError, match=r"moves\.index"):
        read_index(index_file(tmp_path))


def test_a_caption_outside_of_its_clip_is_refused():
    index = index_of([("a wave", 0)], [[1, 0]])
    with pytest.raises(InputError, match="outside"):
        replace(index, captions=(replace(index.captions[0], end=5),))
    with pytest.raises(InputError, match="do not fit"):
        replace(index, captions=())


@pytest.mark.parametrize("tokens", [1, 3, 7, 10, 14, 40])
def test_latents_are_stretched_or_repeated_to_any_length(tokens):
    latents = np.arange(10, dtype=np.float32)[:, None]
    timed = stretched(latents, tokens)
    assert timed.shape == (tokens, 1) and timed.min() >= 0 and timed.max() <= 9
    if 10 / LONGEST_STRETCH <= tokens <= 10 * LONGEST_STRETCH:
        assert timed[0, 0] == 0 and timed[-1, 0] == 9 and (np.diff(timed[:, 0]) >= 0).all()


def test_thinning_keeps_what_is_rare_and_says_it_once():
    vectors = [[1, 0, 0], [0.99, 0.1, 0], [0, 1, 0]]
    assert float(np.dot(vectors[0], vectors[1])) > SAME_OF_CLIP
    index = thinned(index_of([("a", 1), ("b", 1), ("c", 1)], vectors))
    assert [caption.text for caption in index.captions] == ["a", "c"]
    assert [clip.id for clip in index.clips] == ["clip1"] and len(index.latents) == 6


def test_no_clip_of_val_or_test_is_in_the_index_that_ships():
    index = read_index(SHIPPED / "starter" / MOVES_FILE)
    splits = Path(latentmotion.data.__file__).parent / "splits"
    texts = [(splits / f"{name}.txt").read_text() for name in ("val", "test")]
    lines = [line.split() for text in texts for line in text.splitlines()]
    held_out = {row[1] for row in lines if len(row) == 3}
    takes = {row[1].rpartition("-")[0] for row in lines if row[:1] == ["snu"]}
    ids = {clip.id for clip in index.clips}
    assert len(ids) > 2000 and len(held_out) > 700 and len(takes) > 50
    assert not ids & held_out
    assert not {name.rpartition("-")[0] for name in ids if name.startswith("snu-")} & takes
    assert all(source.license and source.credit for source in index.sources)
