"""The models inside the package, above all the one that generates where none is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open

from latentmotion import MotionPipeline
from latentmotion.errors import InputError
from latentmotion.model.card import DEFAULT, find_model, read_card, shipped_models
from latentmotion.networks.checkpoint import WEIGHTS_FILE, load_model
from latentmotion.networks.vae.convolutional import ConvolutionalVAE


@pytest.fixture(scope="module")
def generate() -> MotionPipeline:
    return MotionPipeline.from_pretrained(threads=1)


def test_both_models_ship_and_the_distilled_one_is_the_default(generate: MotionPipeline) -> None:
    assert shipped_models() == ("fast", "starter")
    assert generate.card.name == DEFAULT == "fast"
    assert generate.card.few_step is not None and generate.card.figures["teacher"] == "starter"


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_few_steps_do_what_the_sentence_says(generate: MotionPipeline, steps: int) -> None:
    sentences = ["a person walks forward", "a person lies down on the floor", "a person squats"]
    walk, lie, squat = (motion.joints for motion in generate.batch(sentences, 4, steps=steps))
    lies = [m.joints for m in generate.batch([sentences[1]] * 8, 4, range(8), steps=steps)]
    assert walk[-1, 0, 2] - walk[0, 0, 2] > 1.0, "walks less than a meter"
    assert (walk[:, 15, 1] > walk[:, 0, 1] + 0.3).all(), "who walks is not upright"
    assert lie[-1, 0, 1] < 0.3, "the pelvis of who lies down stays up"
    assert np.median([one[-1, 15, 1] for one in lies]) < 0.3, "heads of who lies down stay up"
    assert squat[:, 0, 1].min() < squat[-1, 0, 1] - 0.2, "who squats stays up"


def test_other_steps_and_samplers_are_refused_with_what_there_is(
    generate: MotionPipeline,
) -> None:
    with pytest.raises(InputError, match="1, 2, 4"):
        generate("a person walks", steps=50)
    with pytest.raises(InputError, match="ddim"):
        generate("a person walks", sampler="heun")


def test_the_text_encoder_is_in_the_package_once(tmp_path: Path, generate: MotionPipeline) -> None:
    assert not (find_model("fast") / "text_encoder.onnx").exists()
    copy = shutil.copytree(find_model("fast"), tmp_path / "mine")
    elsewhere = MotionPipeline.from_pretrained(copy, threads=1)
    np.testing.assert_array_equal(
        *(model("a person waves", 2, takes=1).joints for model in (elsewhere, generate))
    )


@pytest.mark.parametrize("name", shipped_models())
def test_cards_name_data_license_and_no_path_of_a_machine(name: str) -> None:
    provenance = read_card(find_model(name)).provenance
    assert provenance.license == "CC BY-SA 3.0 Unported"
    assert {entry.partition(":")[0] for entry in provenance.data} == {
        "cmu",
        "snu",
        "hdm05",
        "composed",
        "gestures",
    }
    assert provenance.commands and not any(" /" in command for command in provenance.commands)


def test_fast_finds_its_encoder_in_the_starters_folder() -> None:
    """`export --share-encoder` left it out of `fast`; the same weights come back."""
    with safe_open(find_model("fast") / WEIGHTS_FILE, "np") as file:
        assert not any(name.startswith("vae.encoder") for name in file.keys())  # noqa: SIM118
    fast, starter = (load_model(find_model(name)).vae for name in ("fast", "starter"))
    assert isinstance(fast, ConvolutionalVAE) and isinstance(starter, ConvolutionalVAE)
    pairs = zip(fast.encoder.parameters(), starter.encoder.parameters(), strict=True)
    assert all(torch.equal(one, other) for one, other in pairs)
