"""The T2M evaluator: the authors' numbers, reached through the converter, and its laws."""

from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from latentmotion.cli.main import main
from latentmotion.convert.evaluators import convert_evaluator, evaluator_weights
from latentmotion.data.clip import Caption
from latentmotion.errors import FileFormatError, InputError, ModelError
from latentmotion.evaluation.evaluators.interface import TextMotionEvaluator, load_evaluator
from latentmotion.evaluation.evaluators.text_motion import T2MEvaluator
from latentmotion.evaluation.evaluators.text_motion_network import TextMotionConfig
from latentmotion.evaluation.evaluators.words import KEYWORDS, PARTS_OF_SPEECH, read_glove
from tests.support.evaluator_files import (
    WORDS,
    write_checkpoint,
    write_glove,
    write_statistics,
)
from tests.support.golden import formula, golden_input, prefix_mask, relative

KEYS = {"text_encoder": "t2m_textencoder", "movement_encoder": "t2m_moveencoder"}


def caption(text: str, tokens: str = "") -> Caption:
    return Caption(text, 0, 1, tokens)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("evaluator")
    files = (
        write_checkpoint(place / "finest.tar"),
        write_statistics(place / "meta"),
        write_glove(place / "glove"),
    )
    convert_evaluator(*files, place / "converted")
    return place


@pytest.fixture(scope="module")
def evaluator(folder: Path) -> T2MEvaluator:
    found = load_evaluator(folder / "converted")
    assert isinstance(found, T2MEvaluator)
    return found


def motions(lengths: list[int]) -> list[np.ndarray]:
    generator = np.random.default_rng(1)
    return [generator.normal(size=(n, 263)).astype(np.float32) for n in lengths]


@torch.no_grad()
@pytest.mark.parametrize("layout", ["finest.tar", "mld.ckpt"])
def test_the_authors_numbers(shared: Path, tmp_path: Path, layout: str) -> None:
    golden = np.load(shared / "reference" / "mld_outputs.npz")
    shapes = json.loads((shared / "reference" / "mld_shapes.json").read_text())["shapes"]
    state = {
        key: torch.from_numpy(formula(key, tuple(shape)))
        for key, shape in shapes.items()
        if key.startswith("t2m_")
    }
    config = TextMotionConfig()
    networks = config.build()
    networks.load_state_dict(evaluator_weights(written(tmp_path / layout, state)))
    networks.eval()
    motion = golden_input("eval_motion", (4, 196, 263))
    embedding = networks.motions(motion, prefix_mask([196, 140, 64, 40], 196))
    assert relative(embedding, golden["evaluator_motion_embedding"]) < 1e-5
    words, parts = golden_input("word", (4, 22, 300)), golden["evaluator_pos_index"]
    mask = prefix_mask([22, 15, 9, 4], 22)
    embedding = networks.texts(words, torch.from_numpy(parts.astype(np.int64)), mask)
    assert relative(embedding, golden["evaluator_text_embedding"]) < 1e-5


def written(path: Path, state: dict[str, Tensor]) -> Path:
    names = {**KEYS, "motion_encoder": "t2m_motionencoder"}
    parts = {
        part: {k.removeprefix(f"{head}."): v for k, v in state.items() if k.startswith(f"{head}.")}
        for part, head in names.items()
    }
    torch.save(parts if path.suffix == ".tar" else {"state_dict": state}, path)
    return path


@pytest.mark.parametrize("kind", ["humanml3d", "kit"])
def test_names_and_shapes_are_the_official_ones(shared: Path, kind: str) -> None:
    lines = (shared / "spec" / f"keys_t2m_evaluator_{kind}.txt").read_text().splitlines()
    official = {line.split("\t")[0]: line.split("\t")[1] for line in lines if "\t" in line}
    state = TextMotionConfig(features=263 if kind == "humanml3d" else 251).build().state_dict()
    heads = {**KEYS, "motion_encoder": "t2m_motionencoder"}
    found = {
        f"{heads[name.split('.')[0]]}.{name.partition('.')[2]}": str(list(tensor.shape))
        for name, tensor in state.items()
    }
    assert found == official


def test_statistics_and_words_of_the_authors_load(shared: Path, tmp_path: Path) -> None:
    for name in ("our_vab_words.pkl", "our_vab_idx.pkl"):
        shutil.copyfile(shared / "data" / "t2m_vocabulary" / name, tmp_path / name)
    np.save(tmp_path / "our_vab_data.npy", np.random.default_rng(0).normal(size=(4199, 300)))
    checkpoint = write_checkpoint(tmp_path / "finest.tar")
    statistics = shared / "data" / "t2m_evaluator_statistics"
    convert_evaluator(checkpoint, statistics, tmp_path, tmp_path / "out")
    found = load_evaluator(tmp_path / "out")
    assert isinstance(found, T2MEvaluator)
    std = np.load(statistics / "t2m_std.npy").astype(np.float32)
    assert np.array_equal(found.normalizer.std, std)
    read = found.vectors([caption("", "a/DET man/NOUN walk/VERB"), caption("A man walks.")])
    assert np.array_equal(read.words[0, 3], read.words[1, 3])


def test_it_is_a_text_motion_evaluator(evaluator: T2MEvaluator) -> None:
    assert isinstance(evaluator, TextMotionEvaluator)
    assert evaluator.width == 5
    assert len(evaluator.fingerprint) == 64


def test_each_motion_is_what_it_is_alone(evaluator: T2MEvaluator) -> None:
    batch = motions([40, 7, 64, 40, 4, 43])
    together = evaluator.motions(batch)
    alone = np.concatenate([evaluator.motions([motion]) for motion in batch])
    assert np.abs(together - alone).max() < 1e-6
    cut = evaluator.motions([batch[5][:40]])
    assert np.abs(together[5] - cut[0]).max() < 1e-6


def test_contacts_are_not_looked_at(evaluator: T2MEvaluator) -> None:
    (motion,) = motions([16])
    other = motion.copy()
    other[:, -4:] = 1
    assert np.array_equal(evaluator.motions([motion]), evaluator.motions([other]))


def test_each_caption_is_what_it_is_alone(evaluator: T2MEvaluator) -> None:
    captions = [caption("a man walks"), caption("fast"), caption("", "a/DET man/NOUN"), caption("")]
    captions += captions[:2]
    together = evaluator.texts(captions)
    alone = np.concatenate([evaluator.texts([one]) for one in captions])
    assert np.abs(together - alone).max() < 1e-6
    assert evaluator.texts([]).shape == (0, 5)
    assert evaluator.motions([]).shape == (0, 5)


def test_words_are_read_as_the_authors_read_them(folder: Path) -> None:
    glove = read_glove(folder / "glove")
    vectors = np.load(folder / "glove" / "our_vab_data.npy")[::-1]
    tagged = caption("", "a/DET zebra/NOUN walk/NOUN walks/VERB fast/ADV")
    read = glove([tagged])
    rows = ["sos", "a", "zebra", "walk", "unk", "fast", "eos"]
    assert np.allclose(read.words[0], vectors[[WORDS.index(row) for row in rows]])
    parts = [PARTS_OF_SPEECH[part] for part in read.parts[0]]
    assert parts == ["OTHER", "DET", "NOUN", "Act_VIP", "OTHER", "Desc_VIP", "OTHER"]
    assert read.mask.all()


def test_long_sentences_end_after_twenty_words(folder: Path) -> None:
    read = read_glove(folder / "glove")([caption("", " ".join(["man/NOUN"] * 30)), caption("a")])
    assert read.mask.sum(1).tolist() == [22, 3]
    assert np.all(read.words[1, 3:] == 0)


def test_parts_of_speech_are_fifteen() -> None:
    assert len(PARTS_OF_SPEECH) == 15 and PARTS_OF_SPEECH[-1] == "OTHER"
    words = [word for words in KEYWORDS.values() for word in words.split()]
    assert len(words) == len(set(words)) == 12 + 13 + 10 + 34 + 12


def test_a_motion_of_other_features_or_no_movement(evaluator: T2MEvaluator) -> None:
    with pytest.raises(InputError, match=r"251 features a frame.*takes 263"):
        evaluator.motions([np.zeros((8, 251), np.float32)])
    with pytest.raises(InputError, match="3 frames; the evaluator needs 4"):
        evaluator.motions([np.zeros((3, 263), np.float32)])


def test_a_changed_weight_changes_the_fingerprint(folder: Path, tmp_path: Path) -> None:
    files = folder / "finest.tar", folder / "meta", folder / "glove"
    convert_evaluator(*files, tmp_path / "same")
    write_checkpoint(tmp_path / "other.tar", TextMotionConfig(263, 4, 300, 8, 6, 6, 4))
    convert_evaluator(tmp_path / "other.tar", *files[1:], tmp_path / "other")
    first, same, other = (
        load_evaluator(place).fingerprint
        for place in (folder / "converted", tmp_path / "same", tmp_path / "other")
    )
    assert first == same != other


def test_the_command_converts(folder: Path, tmp_path: Path) -> None:
    arguments = f"--statistics {folder}/meta --glove {folder}/glove -o {tmp_path}/out"
    main(["convert", "evaluator", str(folder / "finest.tar"), *arguments.split()])
    assert isinstance(load_evaluator(tmp_path / "out"), T2MEvaluator)
    (tmp_path / "run").mkdir()
    (tmp_path / "out").rename(tmp_path / "run" / "model")
    assert isinstance(load_evaluator(tmp_path / "run"), T2MEvaluator)


class Attack:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return print, ("this must not be printed",)


BAD_CHECKPOINTS = {
    "lacks text_encoder, movement_encoder, motion_encoder": {"epoch": 1},
    "found .1, 2.": [1, 2],
    "lacks motion_encoder": {
        "text_encoder": {"a": torch.zeros(1)},
        "movement_encoder": {"a": torch.zeros(1)},
    },
    "no evaluator of the T2M code": {
        name: {"a": torch.zeros(1)}
        for name in ("text_encoder", "movement_encoder", "motion_encoder")
    },
    "holds more than tensors": Attack(),
}


@pytest.mark.parametrize("message", BAD_CHECKPOINTS)
def test_another_file_is_refused(
    folder: Path, tmp_path: Path, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "finest.tar"
    torch.save(BAD_CHECKPOINTS[message], path)
    with pytest.raises(ModelError, match=message):
        convert_evaluator(path, folder / "meta", folder / "glove", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert not capsys.readouterr().out


def test_a_truncated_file_is_refused(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "finest.tar"
    path.write_bytes((folder / "finest.tar").read_bytes()[:1000])
    with pytest.raises(ModelError, match="damaged"):
        evaluator_weights(path)
    with pytest.raises(ModelError, match="does not exist"):
        evaluator_weights(tmp_path / "none.tar")


def test_statistics_that_do_not_fit(folder: Path, tmp_path: Path) -> None:
    write_statistics(tmp_path / "short", 251)
    for statistics, message in ((tmp_path, "neither mean.npy nor t2m_mean"), ("short", "251")):
        files = folder / "finest.tar", tmp_path / statistics, folder / "glove"
        with pytest.raises(InputError, match=message):
            convert_evaluator(*files, tmp_path / "out")


def test_word_vectors_that_do_not_fit(folder: Path, tmp_path: Path) -> None:
    files = folder / "finest.tar", folder / "meta", write_glove(tmp_path, width=50)
    with pytest.raises(InputError, match="50 numbers, the evaluator reads 300"):
        convert_evaluator(*files, tmp_path / "out")


def test_bad_glove_folders(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"lacks our_vab_data\.npy"):
        read_glove(tmp_path)
    write_glove(tmp_path, ["a", "unk"])
    with pytest.raises(FileFormatError, match="lacks the words sos, eos"):
        read_glove(tmp_path)
    write_glove(tmp_path)
    np.save(tmp_path / "our_vab_data.npy", np.zeros((3, 300)))
    with pytest.raises(FileFormatError, match="'sos' has no row among the 3"):
        read_glove(tmp_path)
    (tmp_path / "our_vab_words.pkl").write_bytes(pickle.dumps(Attack()))
    with pytest.raises(FileFormatError, match="print"):
        read_glove(tmp_path)
    (tmp_path / "our_vab_words.pkl").write_bytes(pickle.dumps({"a": 1}))
    with pytest.raises(FileFormatError, match="found a dict, expected list"):
        read_glove(tmp_path)


def test_bad_evaluator_folders(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="is not an evaluator"):
        load_evaluator(tmp_path)
    place = tmp_path / "copy"
    shutil.copytree(folder / "converted", place)
    card = json.loads((place / "evaluator.json").read_text())
    for change, message in (
        ({"kind": "smell"}, "kind 'smell', known are text_motion, action"),
        ({"format": 2}, "format 2, expected 1"),
        ({"words": "student-0", "vocabulary": []}, "lacks its text encoder 'student-0'"),
        ({"nonsense": 1}, "unknown key 'nonsense'"),
    ):
        (place / "evaluator.json").write_text(json.dumps({**card, **change}))
        with pytest.raises(ModelError, match=message):
            load_evaluator(place)
    (place / "evaluator.json").write_text("{")
    with pytest.raises(ModelError, match="damaged"):
        load_evaluator(place)
    (place / "evaluator.json").write_text(json.dumps(card))
    (place / "weights.safetensors").write_bytes(b"123")
    with pytest.raises(ModelError, match="cannot be read"):
        load_evaluator(place)
