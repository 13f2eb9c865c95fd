"""What a new user gets wrong: one line that says so, exit code 2, and nothing half-written."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.data.sources.actor import ACTIONS
from latentmotion.evaluation.evaluators.action import (
    ActionClassifier,
    MotionGRUConfig,
    save_action_classifier,
)
from latentmotion.model.card import find_model
from latentmotion.storage import pickles
from tests.cli.conftest import Refused
from tests.support.action_files import write_humanact12, write_uestc
from tests.support.moving_figures import write_moving_figures


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Good things, and each damaged in some way."""
    place = tmp_path_factory.mktemp("place")
    (place / "empty").mkdir()
    (place / "file.txt").write_text("hello\n")
    (place / "sentences.txt").write_text("a person walks\n")
    write_moving_figures(place / "data", train=2, val=2)
    shutil.copytree(place / "data", place / "cut_data")
    (place / "cut_data" / "manifest.json").write_text("{")
    poses = write_humanact12(place / "poses.pkl", frames=(20, 21, 22, 23))
    (place / "cut.pkl").write_bytes(poses.read_bytes()[:3000])
    (place / "code.pkl").write_bytes(pickle.dumps(print))
    for name in ("counts", "names", "shapes"):
        write_uestc(place / name)
    (place / "counts" / "info" / "num_frames_min.txt").write_text("x\n" * 5)
    (place / "names" / "info" / "names.txt").write_bytes(b"\xff\xfe\x81")
    content = pickles.load(place / "shapes" / "vibe_cache_refined.pkl")
    content["pose"][1] = np.zeros((70, 10))
    (place / "shapes" / "vibe_cache_refined.pkl").write_bytes(pickle.dumps(content))
    config = MotionGRUConfig()
    about = ActionClassifier(ACTIONS, "smpl", config)
    state = config.build().state_dict()
    save_action_classifier(place / "gru", about, state)
    shutil.copytree(place / "gru", place / "cut_gru")
    (place / "cut_gru" / "weights.safetensors").write_bytes(b"abc")
    torch.save({"model": state | {"linear1.bias": torch.full((30,), torch.nan)}}, place / "nan.tar")
    shutil.copytree(find_model("starter"), place / "cut_model")
    (place / "cut_model" / "weights.safetensors").write_bytes(b"abc")
    return place


PREPARE, TRAIN = "data prepare", "--data data --device cpu -o out --set training"
WRONG = {
    f"{PREPARE} humanact12 none -o out": "none: cannot be read: No such file or directory; ",
    f"{PREPARE} humanact12 empty -o out": "Is a directory",
    f"{PREPARE} humanact12 cut.pkl -o out": "exhausted before end of frame); download it again",
    f"{PREPARE} humanact12 code.pkl -o out": "holds builtins.print",
    f"{PREPARE} humanact12 poses.pkl --hold -3 -o out": "--hold -3: expected",
    f"{PREPARE} humanact12 poses.pkl -o file.txt": "choose another folder",
    f"{PREPARE} uestc empty -o out": "no file",
    f"{PREPARE} uestc counts -o out": "a number in each",
    f"{PREPARE} uestc names -o out": "cannot be read as text",
    f"{PREPARE} uestc shapes -o out": "of the shapes",
    f"{PREPARE} labelled empty -o out": "expected motion files",
    f"train classifier {TRAIN}.steps=-1": "steps -1: expected 1 or more",
    f"train evaluator {TRAIN}.batch_size=0": "batch_size 0: expected 1 or more",
    "train classifier --data data -o data --device cpu": "holds data or a model",
    "train evaluator --data data -o cut_model --device cpu": "holds data or a model",
    "train classifier --data cut_data -o out --device cpu": "is not JSON",
    "convert evaluator nan.tar -o out": "not finite",
    "convert evaluator empty -o out": "no PyTorch checkpoint",
    "convert evaluator code.pkl -o out": "could run code",
    "evaluate starter --data data --evaluator cut_gru": "weights.safetensors cannot be read",
    "evaluate starter --data data --evaluator data": "is not an evaluator",
    "evaluate cut_model --data data": "weights.safetensors cannot be read",
    "evaluate starter --data data --body file.txt": "the ending '.txt' is unknown",
    "evaluate starter --data data -o data": "choose another folder",
    "evaluate starter --data data --split val --steps 0 -o out": "0 sampling steps",
    "evaluate starter --data data --split val --guidance nan -o out": "guidance nan",
    "evaluate starter --data data --split val --seed -1 -o out": "seed -1",
    "evaluate starter --data data --split val --multimodality -1 -o out": "-1 captions",
    "evaluate starter --data data --split val --evaluator gru -o out": "the evaluator",
    "study make starter starter --prompts sentences.txt --order-seed -1 -o s.html": "--order-seed",
    "study make starter data --prompts sentences.txt -o s.html": "neither a model folder nor",
    "study report file.txt --key empty": "expected a file, name one in it",
    "experiment run vae --data empty -o out --device cpu": "expected a prepared data set",
    "experiment run vaee --data data -o out --device cpu": "did you mean 'vae'",
    "export cut_model -o out": "weights.safetensors cannot be read",
    "generate walk --threads -4 -o a.npz": "-4 threads",
    "generate walk --runtime pytorch --device foo -o a.npz": "no device 'foo'",
    "generate walk --runtime pytorch --device cuda:99 -o a.npz": "no device 'cuda:99'",
}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
def test_one_line(words: str, place: Path, refused: Refused) -> None:
    assert WRONG[words] in refused(words, place, warned=True)
