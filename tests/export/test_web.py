"""One graph for web pages: what Python makes of a sentence, the graph makes of its tokens."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from tokenizers import Tokenizer

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.engine.session import open_session
from latentmotion.errors import ModelError
from latentmotion.export.web import export_web, motion_file
from latentmotion.model.card import find_model

SENTENCES = ("a person walks in a circle", "he jumps", "a man waves " + "and waves " * 80)


def joints(folder: Path, sentence: str, frames: int, seed: int, guidance: float) -> np.ndarray:
    manifest = json.loads((folder / "web.json").read_text("utf-8"))
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    latents = manifest["latents"]
    tokens = -(-frames // latents["framesPerToken"])
    return open_session(folder / "motion_4.onnx", "onnxruntime", 1)(
        tokens=np.array([tokenizer.encode(sentence).ids]),
        noise=SeededNoise([seed])((1, tokens, latents["width"])),
        frames=np.array([frames]),
        guidance=np.array([guidance], np.float32),
    )[0]


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.LongSentenceWarning")
@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
@pytest.mark.parametrize("frames", (14, 81, 196))
def test_the_graph_makes_the_joints_that_python_makes(
    web_folder: Path, four_steps: Path, frames: int
):
    pipeline = MotionPipeline.from_pretrained(four_steps, "onnxruntime", 1)
    for seed, sentence in enumerate(SENTENCES):
        found = joints(web_folder, sentence, frames, seed, 2.5)
        # The graph starts from noise.
        expected = pipeline.batch([sentence], frames / 20, [seed], 4, 2.5, from_clips=False)[
            0
        ].joints
        np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.LongSentenceWarning")
def test_the_graph_predicts_the_length_that_python_predicts(web_folder: Path, four_steps: Path):
    pipeline = MotionPipeline.from_pretrained(four_steps, "onnxruntime", 1)
    tokenizer = Tokenizer.from_file(str(web_folder / "tokenizer.json"))
    session = open_session(web_folder / "seconds.onnx", "onnxruntime", 1)
    found = [session(tokens=np.array([tokenizer.encode(s).ids]))[0, 0] for s in SENTENCES]
    assert pipeline.lengths
    # The graph reads no English, so that bounds of single acts are not in it.
    expected = pipeline.lengths.usual(pipeline.text_encoder(SENTENCES).pooled)
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.usefixtures("without_shape_checks")
def test_the_command_writes_eight_bits_that_move_joints_by_millimeters(
    web_folder: Path, four_steps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("kept")
    with pytest.raises(SystemExit):
        main(["export", str(four_steps), "--web", "-o", str(tmp_path / "mine")])
    assert (tmp_path / "mine" / "notes.txt").read_text() == "kept"
    small = tmp_path / "small"
    main(["export", str(four_steps), "--web", "-o", str(small)])
    assert "MB)" in capsys.readouterr().out
    sizes = [(folder / "weights.bin").stat().st_size for folder in (small, web_folder)]
    assert sizes[0] < 0.97 * sizes[1]  # `fast` ships in 8 bits but for the last layer
    found, exact = (joints(folder, SENTENCES[0], 80, 1, 4.0) for folder in (small, web_folder))
    assert 1e-4 < np.linalg.norm(found - exact, axis=-1).mean() < 0.02


def test_the_folder_holds_what_generation_needs_and_says_who_made_nothing(web_folder: Path):
    manifest = json.loads((web_folder / "web.json").read_text("utf-8"))
    files = {"motion_4.onnx", "seconds.onnx", "tokenizer.json", "weights.bin"}
    assert set(manifest["files"]) == files
    assert manifest["steps"] == [4]
    assert len(manifest["hash"]) == 64
    graph = onnx.load(web_folder / "motion_4.onnx", load_external_data=False)
    assert {value.name for value in graph.graph.input} == {"tokens", "noise", "frames", "guidance"}
    assert not any("encoder.first" in t.name and "vae" in t.name for t in graph.graph.initializer)
    assert not any(node.metadata_props or node.doc_string for node in graph.graph.node)
    largest = max(len(tensor.raw_data) for tensor in graph.graph.initializer)
    assert largest < 1024


def test_models_of_many_steps_are_refused(tmp_path: Path):
    with pytest.raises(ModelError, match="no fused sampler"):
        export_web(find_model("starter"), tmp_path / "web")
    assert not list(tmp_path.iterdir())


def test_a_model_of_labels_takes_their_numbers(student: Path, labels_folder: Path):
    folder = labels_folder
    manifest = json.loads((folder / "web.json").read_text("utf-8"))
    assert (manifest["prompts"], manifest["labels"]) == ("labels", list("012345"))
    assert not {"tokenizer.json", "seconds.onnx"} & set(manifest["files"])
    assert (manifest["steps"], manifest["usual"]["steps"]) == ([2], 2)
    pipeline = MotionPipeline.from_pretrained(student, threads=1)
    session = open_session(folder / motion_file(2), "onnxruntime", 1)
    for number, label in enumerate("012"):
        expected = pipeline.batch([label], 2.0, [number], 2, 3.0)[0].joints
        noise = SeededNoise([number])((1, pipeline.card.latents.tokens_of(40), 8))
        found = session(
            tokens=np.array([[number]]),
            noise=noise,
            frames=np.array([40]),
            guidance=np.array([3.0], np.float32),
        )
        np.testing.assert_allclose(found[0], expected, atol=1e-4)
