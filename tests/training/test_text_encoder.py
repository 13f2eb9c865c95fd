"""The student of a tiny teacher: first weights, losses, batches, run folder, exported files."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file
from torch import nn

from latentmotion.engine.encoder import StudentTextEncoder, UnknownWordsWarning
from latentmotion.errors import DataError, InputError, ModelError
from latentmotion.networks.text_encoder import (
    NetworkShape,
    StudentNetwork,
    pack,
    packed,
    teacher_state,
)
from latentmotion.training.distributed import Ranks
from latentmotion.training.experiment import TrainingSettings
from latentmotion.training.loop import train
from latentmotion.training.run_folder import read_journal
from latentmotion.training.text_encoder import (
    GROUP,
    SentenceBatch,
    SentenceSampler,
    StudentRecipe,
    TaggedCaption,
    TeacherOutputs,
    TextEncoderStage,
    TrainingSet,
    ValidationSentences,
    compare,
    distillation_losses,
    padded,
    parse_line,
    train_text_encoder,
)
from tests.support.small_training import CONTEXT, killed_at
from tests.support.tiny_text import CAPTIONS, teacher_tokenizer, tiny_teacher

SETTINGS = TrainingSettings(
    steps=6, batch_size=4, warm_up=2, ema_decay=0.0, precision="bfloat16", report_every=1,
    validate_every=3, snapshot_every=2, sample_every=0,
)  # fmt: skip


def test_student_with_all_layers_is_its_teacher() -> None:
    teacher = tiny_teacher()
    shape = NetworkShape(teacher_tokenizer().get_vocab_size(), 16, 4, 2, 32, 32)
    network = StudentNetwork(shape).eval()
    pieces = range(shape.vocabulary)
    network.load_state_dict(teacher_state(teacher.model.state_dict(), pieces, range(4), 32))
    expected = teacher(CAPTIONS)
    tokens, mask = padded([e.ids for e in teacher_tokenizer().encode_batch(list(CAPTIONS))])
    with torch.no_grad():
        pooled, words = network(tokens, mask)
    np.testing.assert_allclose(pooled, expected.pooled, atol=1e-5)
    np.testing.assert_allclose(words[mask], expected.words[mask], atol=1e-5)


def test_losses_are_zero_for_the_teacher_itself() -> None:
    words = torch.randn(2, 3, 4)
    mask = torch.tensor([[True, True, True], [True, True, False]])
    pooled = torch.nn.functional.normalize(torch.randn(2, 4), dim=1)
    batch = SentenceBatch(torch.zeros(2, 3, dtype=torch.long), mask, pooled, mask, words[mask])
    assert not any(distillation_losses(pooled, words, batch).values())
    losses = distillation_losses(-pooled, words, batch)
    assert float(losses["total"]) == pytest.approx(80)
    assert float(losses["sentence"]) == pytest.approx(4)


def test_batches_follow_from_the_step_alone_and_cover_everything() -> None:
    lengths = np.arange(100) % 7
    sampler = SentenceSampler(lengths, 10, seed=3)
    whole = [sampler(step) for step in range(25)]
    assert sorted(np.concatenate(whole[:10])) == list(range(100))
    np.testing.assert_array_equal(whole[13], SentenceSampler(lengths, 10, seed=3)(13))
    assert not np.array_equal(whole[0], whole[10])
    assert max(np.ptp(lengths[rows]) for rows in whole) <= 1  # of similar length


def test_few_sentences_make_one_smaller_batch() -> None:
    assert sorted(SentenceSampler(np.array([4, 2, 3]), 10, seed=0)(5)) == [0, 1, 2]


def tiny_stage(ranks: Ranks = CONTEXT.ranks) -> TextEncoderStage:
    ids = [row.ids for row in teacher_tokenizer().encode_batch(list(CAPTIONS) * 9)]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in ids])])
    random = np.random.default_rng(0)
    words = random.standard_normal((starts[-1], 8)).astype(np.float16)
    pooled = random.standard_normal((len(ids), 8)).astype(np.float32)
    torch.manual_seed(0)
    network = StudentNetwork(NetworkShape(teacher_tokenizer().get_vocab_size(), 8, 1, 2, 16, 16))
    aligned = [row % 3 > 0 for row in range(len(ids))]
    data = TrainingSet(ids, aligned, TeacherOutputs(pooled, words, starts))
    context = replace(CONTEXT, ranks=ranks)
    return TextEncoderStage(
        network, data, ValidationSentences(CAPTIONS, ids, pooled), SETTINGS, context
    )


def test_an_interrupted_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    expected, _ = train(tiny_stage(), SETTINGS, whole, CONTEXT)
    with killed_at(5):
        train(tiny_stage(), SETTINGS, parts, CONTEXT)
    found, _ = train(tiny_stage(), SETTINGS, parts, CONTEXT)
    for one, other in zip(expected.parameters(), found.parameters(), strict=True):
        assert torch.equal(one, other)
    assert read_journal(whole) == read_journal(parts)


def test_ranks_share_a_batch() -> None:
    with torch.no_grad():
        whole = tiny_stage()(0)["sentence"]
        parts = [tiny_stage(Ranks(rank, 2))(0)["sentence"] for rank in range(2)]
    torch.testing.assert_close(sum(parts) / 2, whole)


def test_losses_are_in_float32_where_the_network_is_not() -> None:
    with torch.autocast("cpu", torch.bfloat16):
        losses = tiny_stage()(0)
    assert {loss.dtype for loss in losses.values()} == {torch.float32}


def test_packed_rows_are_within_half_a_step() -> None:
    weight = torch.randn(5, 7) * torch.tensor([[1e-3], [1], [100], [0], [1]])
    integers, scale = pack(weight)
    assert integers.dtype == torch.int8
    assert ((integers * scale - weight).abs() <= scale * 0.5001).all()


def test_figures_of_the_teacher_itself_are_perfect() -> None:
    same = np.random.default_rng(0).standard_normal((70, 8)).astype(np.float32)
    same /= np.linalg.norm(same, axis=1, keepdims=True)
    figures = compare(same, same)
    assert (figures.nearest, figures.own_first) == (1, 1)
    assert figures.cosine == pytest.approx(1)
    turned = compare(np.roll(same, 1, axis=1), same)  # keeps who is near to whom
    assert turned.nearest == 1
    assert turned.own_first < 0.5


RECIPE = StudentRecipe(
    layers=(0, 3), positions=16, training=replace(SETTINGS, steps=3, batch_size=8)
)


def numbered_captions(count: int) -> list[TaggedCaption]:
    texts = [f"person {chr(97 + n % 26)} walks {n}" for n in range(count)] + list(CAPTIONS)
    return [parse_line(f"{text}#person/NOUN walk/VERB") for text in texts]


@pytest.fixture(scope="module")
def encoder_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run with a tiny teacher: sentences, targets, training, files, card."""
    folder = tmp_path_factory.mktemp("student")
    return train_text_encoder(RECIPE, numbered_captions(800), tiny_teacher(), folder, CONTEXT)


def test_run_leaves_all_files_and_a_card(encoder_folder: Path) -> None:
    files = {"text_encoder.onnx", "text_encoder.safetensors", "tokenizer.json", "card.json"}
    assert {path.name for path in encoder_folder.iterdir()} == files
    card = json.loads((encoder_folder / "card.json").read_text())
    assert card["held_out"]["sentences"] > GROUP
    assert set(card["bytes"]) == files - {"card.json"}


def test_journal_has_losses_and_agreement_on_held_out_captions(encoder_folder: Path) -> None:
    lines = read_journal(encoder_folder.parent)
    assert [line["step"] for line in lines] == [1, 2, 3, 3]
    assert {"total", "sentence", "words", "relation", "rate"} <= lines[0].keys()
    card = json.loads((encoder_folder / "card.json").read_text())
    assert lines[-1]["cosine"] == pytest.approx(card["held_out"]["cosine"], abs=0.02)  # of 8 bits


def test_a_run_with_other_settings_is_refused(encoder_folder: Path) -> None:
    captions, teacher = numbered_captions(800), tiny_teacher()
    changed = replace(RECIPE, training=replace(RECIPE.training, learning_rate=1.0))
    with pytest.raises(InputError, match=r"training\.learning_rate"):
        train_text_encoder(changed, captions, teacher, encoder_folder.parent, CONTEXT)
    with pytest.raises(InputError, match="differing: captions"):
        train_text_encoder(RECIPE, captions[1:], teacher, encoder_folder.parent, CONTEXT)


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "report.json").touch()
    with pytest.raises(InputError, match=r"holds data or a model \(report.json\)"):
        train_text_encoder(RECIPE, numbered_captions(800), tiny_teacher(), tmp_path, CONTEXT)


def test_too_few_captions_are_refused_before_training(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="held out for validation, expected 33 or more"):
        train_text_encoder(RECIPE, numbered_captions(20), tiny_teacher(), tmp_path, CONTEXT)
    assert not list(tmp_path.iterdir())


def load_student(path: Path) -> nn.Module:
    """Returns the network of a `text_encoder.safetensors`, for PyTorch."""
    with safe_open(path, "pt") as file:
        shape = {key: int(value) for key, value in file.metadata().items()}
    network = packed(StudentNetwork(NetworkShape(**shape)))
    network.load_state_dict(load_file(path))
    return network


def test_graph_says_what_the_network_says(encoder_folder: Path) -> None:
    student = StudentTextEncoder.load(encoder_folder)
    network = load_student(encoder_folder / "text_encoder.safetensors")
    for caption in CAPTIONS:
        tokens, mask = padded([student.tokenizer.encode(caption).ids])
        pooled, words = network(tokens, mask)
        found = student([caption])
        np.testing.assert_allclose(found.pooled, pooled.detach(), atol=1e-5)
        np.testing.assert_allclose(found.words, words.detach(), atol=1e-5)


def test_graph_takes_padded_batches_too(encoder_folder: Path) -> None:
    student = StudentTextEncoder.load(encoder_folder)
    tokens, mask = padded([student.tokenizer.encode(caption).ids for caption in CAPTIONS])
    pooled, _ = student.session.run(None, {"tokens": tokens.numpy(), "mask": mask.numpy()})
    np.testing.assert_allclose(pooled, student(CAPTIONS).pooled, atol=1e-5)


def test_embedding_does_not_depend_on_company_or_order(encoder_folder: Path) -> None:
    student = StudentTextEncoder.load(encoder_folder)
    together, turned = student(CAPTIONS), student(CAPTIONS[::-1])
    np.testing.assert_array_equal(together.pooled, turned.pooled[::-1])
    for row, caption in enumerate(CAPTIONS):
        alone = student([caption])
        np.testing.assert_array_equal(together.pooled[row], alone.pooled[0])
        np.testing.assert_array_equal(together.words[row][together.mask[row]], alone.words[0])
        assert not together.words[row][~together.mask[row]].any()
    np.testing.assert_allclose(np.linalg.norm(together.pooled, axis=1), 1, atol=1e-5)


def test_unknown_words_are_named_and_still_read(encoder_folder: Path) -> None:
    student = StudentTextEncoder.load(encoder_folder)
    with pytest.warns(UnknownWordsWarning, match=r"'kazo', '猫'"):
        found = student(["person kazo", "猫 walks"])
    assert np.isfinite(found.pooled).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        student([""])


def test_bad_use_is_told(encoder_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one"):
        StudentTextEncoder.load(encoder_folder)([])
    with pytest.raises(ModelError, match="missing"):
        StudentTextEncoder.load(tmp_path)
    for name in ("text_encoder.onnx", "tokenizer.json"):
        (tmp_path / name).write_text("damaged")
    with pytest.raises(ModelError, match="cannot be loaded"):
        StudentTextEncoder.load(tmp_path)
