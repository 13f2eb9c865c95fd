"""The student from a tiny teacher: first weights, loss, resuming, files, the inner ring's side."""

from __future__ import annotations

import itertools
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.errors import InputError, ModelError
from latentmotion.export.text_encoder import load_student
from latentmotion.networks.text_encoder import NetworkShape, StudentNetwork, pack, teacher_state
from latentmotion.text.encoder import StudentTextEncoder, UnknownWordsWarning
from latentmotion.training.text_encoder.corpus import compare, parse_line
from latentmotion.training.text_encoder.driver import StudentRecipe, train_student
from latentmotion.training.text_encoder.stage import (
    Batch,
    Schedule,
    TrainingSet,
    batches,
    distill,
    distillation_loss,
)
from latentmotion.training.text_encoder.targets import Targets, padded
from tests.support.tiny_text import CAPTIONS, teacher_tokenizer, tiny_teacher


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


def test_loss_is_zero_for_the_teacher_itself() -> None:
    words = torch.randn(2, 3, 4)
    mask = torch.tensor([[True, True, True], [True, True, False]])
    pooled = torch.nn.functional.normalize(torch.randn(2, 4), dim=1)
    batch = Batch(torch.zeros(2, 3, dtype=torch.long), mask, pooled, mask, words[mask])
    assert float(distillation_loss(pooled, words, batch)) == 0
    assert float(distillation_loss(-pooled, words, batch)) == pytest.approx(80)


def test_batches_go_on_from_any_step_and_cover_everything() -> None:
    lengths = np.arange(100) % 7
    whole = list(itertools.islice(batches(lengths, 10, 3, 0), 25))
    later = list(itertools.islice(batches(lengths, 10, 3, 13), 12))
    np.testing.assert_array_equal(whole[13:], later)
    assert sorted(np.concatenate(whole[:10])) == list(range(100))


def tiny_set() -> tuple[StudentNetwork, TrainingSet]:
    rows = teacher_tokenizer().encode_batch(list(CAPTIONS) * 4)
    ids = [row.ids for row in rows]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in ids])])
    random = np.random.default_rng(0)
    words = random.standard_normal((starts[-1], 8)).astype(np.float16)
    pooled = random.standard_normal((len(ids), 8)).astype(np.float32)
    torch.manual_seed(0)
    network = StudentNetwork(NetworkShape(teacher_tokenizer().get_vocab_size(), 8, 1, 2, 16, 16))
    aligned = [place % 3 > 0 for place in range(len(ids))]
    return network, TrainingSet(ids, aligned, Targets(pooled, words, starts))


def test_interrupted_run_ends_with_the_same_numbers(tmp_path: Path) -> None:
    schedule = Schedule(steps=6, batch=4, warmup=2)

    def silent(line: str) -> None:
        pass

    unbroken, data = tiny_set()
    distill(unbroken, data, schedule, tmp_path / "unbroken.pt", silent)
    broken, data = tiny_set()
    data_until_killed = _KilledAfter(data, batches=5)
    with pytest.raises(KeyboardInterrupt):
        distill(broken, data_until_killed, schedule, tmp_path / "broken.pt", silent, 3)
    resumed, data = tiny_set()
    distill(resumed, data, schedule, tmp_path / "broken.pt", silent, 3)
    for one, other in zip(unbroken.parameters(), resumed.parameters(), strict=True):
        assert torch.equal(one, other)


class _KilledAfter(TrainingSet):
    """A training set whose reader is interrupted after some batches."""

    def __init__(self, data: TrainingSet, batches: int) -> None:
        super().__init__(data.ids, data.aligned, data.targets)
        object.__setattr__(self, "left", batches)

    def batch(self, rows: np.ndarray) -> Batch:
        object.__setattr__(self, "left", self.left - 1)
        if self.left < 0:
            raise KeyboardInterrupt
        return super().batch(rows)


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


@pytest.fixture(scope="module")
def encoder_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run with a tiny teacher: sentences, targets, training, files, card."""
    folder = tmp_path_factory.mktemp("student")
    recipe = StudentRecipe(Schedule(steps=3, batch=8, warmup=1), layers=(0, 3), positions=16)
    # Many numbered captions, so that the held-out ones fill a group of the measures.
    texts = [f"person {chr(97 + n % 26)} walks {n}" for n in range(800)] + list(CAPTIONS)
    captions = [parse_line(f"{text}#person/NOUN walk/VERB") for text in texts]
    lines: list[str] = []
    return train_student(recipe, captions, tiny_teacher(), folder, lines.append)


def test_run_leaves_all_files_and_a_card(encoder_folder: Path) -> None:
    files = {"text_encoder.onnx", "text_encoder.safetensors", "tokenizer.json", "card.json"}
    assert {path.name for path in encoder_folder.iterdir()} == files
    card = json.loads((encoder_folder / "card.json").read_text())
    assert card["held_out"]["sentences"] > 33
    assert set(card["bytes"]) == files - {"card.json"}


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
