"""Length from the sentence: learned from captions, clamped to the model, optional in a folder."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.diffusion.condition import TextConditioning, UnconditionalTask
from latentmotion.engine.encoder import load_text_encoder
from latentmotion.engine.lengths import QUANTILES, SHORTEST_USUAL, LengthFile, LengthModel
from latentmotion.engine.request import frames_of
from latentmotion.errors import DataError, InputError, ModelError
from latentmotion.model.card import LENGTHS_FILE, file_beside, find_model, read_card
from latentmotion.model.config import ConvolutionalVAEConfig, DenoiserConfig, LatentSpace, Sampling
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import save_model
from latentmotion.training.lengths import (
    CaptionLengths,
    LengthRecipe,
    measured,
    read_caption_lengths,
    train_lengths,
)
from tests.support.untrained import SMALL, card, untrained

SHORT = [f"{who} kicks {how}" for who in ("a person", "a man", "he") for how in ("", "high", "low")]
LONG = [f"{who} walks in a circle, then {does}" for who in ("a person", "a man", "she")
        for does in ("sits down", "waves", "lies down")]  # fmt: skip
ENCODER = "student-3ce408f26463"


@pytest.fixture(scope="module")
def captions() -> CaptionLengths:
    seconds = [2.5 + 0.1 * n for n in range(9)] + [8 + 0.1 * n for n in range(9)]
    return CaptionLengths((*SHORT, *LONG) * 8, np.array(seconds * 8, np.float32))


@pytest.fixture(scope="module")
def recipe() -> LengthRecipe:
    return LengthRecipe(hidden=16, layers=1, passes=60, batch=16, learning_rate=1e-2)


@pytest.fixture(scope="module")
def model(captions: CaptionLengths, recipe: LengthRecipe) -> LengthModel:
    return train_lengths(captions, load_text_encoder(find_model("starter")), recipe)


def constant_model(seconds: float, encoder: str = ENCODER) -> LengthModel:
    bias = np.full(len(QUANTILES), seconds, np.float32)
    hidden, out = np.zeros((2, 384), np.float32), np.zeros((len(QUANTILES), 2), np.float32)
    return LengthModel(encoder, (hidden, out), (np.zeros(2, np.float32), bias))


def test_short_and_long_movements_are_told_apart(
    model: LengthModel, captions: CaptionLengths
) -> None:
    encoder = load_text_encoder(find_model("starter"))
    unseen = ["someone kicks", "someone walks in a circle, then jumps"]
    short, long = model.usual(encoder(unseen).pooled)
    assert 2 < short < 5 and 7 < long < 10
    told = measured(model, captions, encoder, constant=5.0)
    assert told.mae < 0.5 < told.constant_mae and told.inside > 0.6


def test_quantiles_rise_and_do_not_depend_on_company(model: LengthModel) -> None:
    x = np.random.default_rng(0).standard_normal((50, 384)).astype(np.float32)
    found = model(x)
    assert found.shape == (50, len(QUANTILES)) and (np.diff(found, axis=1) >= 0).all()
    np.testing.assert_array_equal(found[7], model(x[7:8])[0])
    assert model.usual(x) == found[:, 2].clip(SHORTEST_USUAL).tolist()


def test_the_same_seed_gives_the_same_model(captions: CaptionLengths, recipe: LengthRecipe) -> None:
    encoder, short = load_text_encoder(find_model("starter")), replace(recipe, passes=2)
    first, again = (train_lengths(captions, encoder, short) for _ in range(2))
    other = train_lengths(captions, encoder, replace(short, seed=1))
    np.testing.assert_array_equal(first.weights[0], again.weights[0])
    assert not np.array_equal(first.weights[0], other.weights[0])


def test_a_file_is_checked(model: LengthModel, tmp_path: Path) -> None:
    path = tmp_path / LENGTHS_FILE
    model.write(path)
    x = np.random.default_rng(0).standard_normal((5, 384)).astype(np.float32) / 20
    np.testing.assert_allclose(LengthModel.read(path, ENCODER)(x), model(x), atol=0.05)
    with pytest.raises(ModelError, match="reads the text encoder"):
        LengthModel.read(path, "clip")
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(ModelError, match="damaged"):
        LengthModel.read(path)
    *first, last = model.weights
    replace(model, weights=(*first, last[:, 1:])).write(path)
    with pytest.raises(ModelError, match="train length"):
        LengthModel.read(path)
    *first, last = model.biases
    replace(model, biases=(*first, last * np.nan)).write(path)
    with pytest.raises(ModelError, match="no model of lengths"):
        LengthModel.read(path)


def test_what_is_predicted_is_what_the_model_makes() -> None:
    card = read_card(find_model("fast"))
    assert frames_of(card, None, 3, 20, [0.1, 5.0, 30.0]) == [12, 100, 196]
    assert frames_of(card, None, 2, 20) == [80, 80]
    assert frames_of(card, 3, 1, 20, [5.0]) == [60]


@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
def test_motions_take_their_sentences_lengths(tmp_path: Path) -> None:
    constant_model(100.0).write(tmp_path / LENGTHS_FILE)
    fast = MotionPipeline.from_pretrained("fast", threads=1)
    assert fast.lengths is not None
    longest = replace(fast, lengths=LengthFile(tmp_path / LENGTHS_FILE, ENCODER))
    assert len(longest("a person walks", steps=1)) == 196
    assert len(longest("a person walks", seconds=1, steps=1)) == 20
    raw = replace(fast, lengths=None)("a person walks", steps=1, clean_up=None)
    assert len(raw) == 80  # clean-up may take time for rest
    kick, long = fast.batch(["a man kicks", "a man walks in a circle, sits down and then waves"])
    assert len(kick) < len(long) <= 196
    assert len(fast("a man kicks", takes=1, clean_up=None)) == len(kick)
    with pytest.raises(InputError, match="sentence is empty"):
        fast(" ")


def test_the_student_borrows_its_teachers_lengths() -> None:
    fast, starter = find_model("fast"), find_model("starter")
    lengths = file_beside(read_card(fast), fast, LENGTHS_FILE)
    assert lengths == starter / LENGTHS_FILE
    unconditional = replace(read_card(fast), condition=UnconditionalTask())
    assert file_beside(unconditional, fast, LENGTHS_FILE) is None


def test_an_older_folder_makes_four_seconds(tmp_path: Path) -> None:
    older = tmp_path / "older"
    shutil.copytree(find_model("starter"), older, ignore=shutil.ignore_patterns(LENGTHS_FILE))
    generate = MotionPipeline.from_pretrained(older, threads=1)
    assert generate.lengths is None
    assert len(generate("a person walks", steps=1, takes=1, clean_up=None)) == 80


def test_lengths_go_with_an_export(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("latentmotion.export.package._write_graphs", lambda *_, **__: None)
    starter = read_card(find_model("starter"))
    small = card(263, "humanml3d", LatentSpace(4, frames_per_token=4))
    task = replace(starter.condition, conditioning=TextConditioning())
    denoiser = DenoiserConfig(latent_width=4, condition_width=384, transformer=SMALL, sine_width=16)
    small = replace(small, condition=task, sampling=Sampling(1, 1.0))
    vae = ConvolutionalVAEConfig(width=8, channels=4)
    save_model(tmp_path / "run", untrained(small, vae, denoiser))
    mine = tmp_path / "mine.safetensors"
    constant_model(6.0).write(mine)
    main(["export", str(tmp_path / "run"), "-o", str(tmp_path / "plain")])
    shipped = find_model("starter") / LENGTHS_FILE
    assert (tmp_path / "plain" / LENGTHS_FILE).read_bytes() == shipped.read_bytes()
    main(["export", str(tmp_path / "run"), "--length", str(mine), "-o", str(tmp_path / "own")])
    motion = torch_pipeline(tmp_path / "own")("a person walks", takes=1, clean_up=None)
    assert len(motion) == 6 * motion.fps
    constant_model(6.0, "clip").write(mine)
    with pytest.raises(SystemExit):
        main(["export", "starter", "--length", str(mine), "-o", str(tmp_path / "wrong")])
    assert "reads the text encoder 'clip'" in capsys.readouterr().err


def write_captions(folder: Path) -> Path:
    folder.mkdir()
    texts = {
        "000001": "a man walks#a/DET#0.0#0.0\na man stops#a/DET#1.0#4.0",
        "000002": "a man jumps#a/DET#0.0#0.0",
        "000003": "a man runs#a/DET#0.0#0.0",
        "000004": "a man kicks#a/DET#0.0#0.0",
        "000005": "a man waves#a/DET#0.0#0.0",
    }
    (folder / "texts").mkdir()
    for name, text in texts.items():
        (folder / "texts" / f"{name}.txt").write_text(text, encoding="utf-8")
    rows = ["a,0,101,000001.npy", "h/P01F100T180A01.npy,0,-1,000002.npy", "b,20,50,000003.npy",
            "c,0,200,000004.npy", "d,0,-1,000005.npy"]  # fmt: skip
    header = "source_path,start_frame,end_frame,new_name"
    (folder / "index.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    (folder / "train.txt").write_text("000001\n000002\n000003\n000005\nM000001", encoding="utf-8")
    (folder / "val.txt").write_text("", encoding="utf-8")
    (folder / "test.txt").write_text("000004", encoding="utf-8")
    return folder


def test_lengths_are_those_of_humanml3ds_readers(tmp_path: Path) -> None:
    folder = write_captions(tmp_path / "captions")
    train = read_caption_lengths(folder, "train")
    assert dict(zip(train.sentences, train.seconds.tolist(), strict=True)) == {
        "a man walks": 5.0,
        "a man stops": 3.0,
        "a man jumps": 4.0,
    }  # not who runs for 29 frames, nor who waves for nobody knows how long
    assert read_caption_lengths(folder, "test").seconds.tolist() == pytest.approx([9.8])
    with pytest.raises(DataError, match="no sentence of the split val"):
        read_caption_lengths(folder, "val")


def test_trained_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, output = write_captions(tmp_path / "captions"), tmp_path / "out.safetensors"
    main(["train", "length", "--captions", str(folder), "-o", str(output)])
    assert "learned from 3 sentences" in capsys.readouterr().out
    again = tmp_path / "again.safetensors"
    main(["train", "length", "--captions", str(folder), "-o", str(again)])
    one, other = LengthModel.read(output), LengthModel.read(again)
    assert one.encoder == ENCODER
    # The text encoder's sums depend on how its engine's threads share them.
    assert np.allclose(one.biases[-1], other.biases[-1], atol=1e-2)
    with pytest.raises(SystemExit):
        main(["train", "length", "--captions", str(tmp_path / "none"), "-o", str(output)])
    capsys.readouterr()
    keep = ["--captions", str(folder), "--keep", str(output), "-o", str(again)]
    with pytest.raises(SystemExit):
        main(["train", "length", "--model", "fast", *keep])
    assert "give one" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["train", "length", *keep[:3], str(tmp_path / "none"), *keep[4:]])
    assert "none is no file" in capsys.readouterr().err


# People's captions are full of misspelled words.
@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.UnknownWordsWarning")
def test_the_shipped_file_tells_lengths_as_documented(shared: Path) -> None:
    if not (shared / "data" / "humanml3d").is_dir():
        pytest.skip("needs HumanML3D's captions")
    test = read_caption_lengths(shared / "data" / "humanml3d", "test")
    some = CaptionLengths(test.sentences[::16], test.seconds[::16])
    folder = find_model("starter")
    shipped = LengthModel.read(folder / LENGTHS_FILE, ENCODER)
    told = measured(shipped, some, load_text_encoder(folder), constant=7.55)
    assert told.mae < 1.7 < 2.1 < told.constant_mae
    assert 0.75 < told.inside < 0.92
