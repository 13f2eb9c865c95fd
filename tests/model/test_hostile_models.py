"""Cards and checkpoints that lie about sizes are told before a network is built."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch

from latentmotion.convert import convert_checkpoint
from latentmotion.convert.mld import Origin
from latentmotion.convert.reading import read_checkpoint
from latentmotion.errors import LatentMotionError, ModelError
from latentmotion.model.card import find_model, read_card
from latentmotion.pipeline import MotionPipeline

CARD = json.loads((find_model("starter") / "model.json").read_text())


def changed(path: list[str], value: Any) -> dict[str, Any]:
    card = json.loads(json.dumps(CARD))
    inner = card
    for key in path[:-1]:
        inner = inner[key]
    assert path[-1] in inner
    inner[path[-1]] = value
    return card


@pytest.mark.parametrize("value", [0, -1, 10**9])
@pytest.mark.parametrize(
    "path",
    [
        ["sampling", "steps"],
        ["latents", "frames_per_token"],
        ["latents", "tokens"],
        ["latents", "width"],
        ["denoiser", "transformer", "hidden"],
        ["denoiser", "transformer", "heads"],
        ["denoiser", "condition_width"],
        ["vae", "features"],
        ["frames"],
    ],
    ids=".".join,
)
def test_numbers_of_cards(path: list[str], value: int, tmp_path: Path) -> None:
    given: Any = [value, value] if path == ["frames"] else value
    (tmp_path / "model.json").write_text(json.dumps(changed(path, given)))
    with pytest.raises(ModelError, match=r"model\.json"):
        read_card(tmp_path)


@pytest.mark.parametrize("kind", [[], {}, 7, "Nothing"])
def test_kinds_of_cards(kind: object, tmp_path: Path) -> None:
    for version in (1, 2):
        card = changed(["vae", "kind"], kind) | {"format": version, "task": kind}
        (tmp_path / "model.json").write_text(json.dumps(card))
        with pytest.raises(ModelError, match=r"model\.json"):
            read_card(tmp_path)


def test_a_graph_of_another_model(tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(find_model("starter"), folder)
    shutil.copy(folder / "decoder.onnx", folder / "denoiser.onnx")
    for graph in folder.glob("fused_*.onnx"):
        graph.unlink()
    model = MotionPipeline.from_pretrained(folder)
    with pytest.raises(ModelError, match=r"denoiser\.onnx cannot take"):
        model("a person walks", seconds=1, steps=1)


ODD = {
    "expanded": lambda: torch.zeros(1).expand(1 << 40),
    "sparse": lambda: torch.zeros(3, 3).to_sparse(),
    "ragged": lambda: torch.nested.nested_tensor([torch.zeros(2), torch.zeros(3)]),
    "empty": lambda: torch.zeros(10**9, 0),
}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", ODD)
def test_tensors_that_are_not_plain(kind: str, tmp_path: Path) -> None:
    torch.save({"vae.a": ODD[kind]()}, tmp_path / "a.ckpt")
    with pytest.raises(ModelError):
        read_checkpoint(tmp_path / "a.ckpt")


@pytest.mark.parametrize("zipped", [True, False])
def test_three_gigabytes_by_name(zipped: bool, tmp_path: Path) -> None:
    class Large:
        def __reduce__(self) -> tuple:
            return bytearray, (3 << 30,)

    path = tmp_path / "a.ckpt"
    torch.save({"a": Large()}, path, _use_new_zipfile_serialization=zipped)
    with pytest.raises(ModelError, match=r"builtins\.bytearray"):
        read_checkpoint(path)


def test_checkpoints_of_sizes_that_no_machine_has(tmp_path: Path) -> None:
    names = ("encoder.middle_block.linear1.weight", "encoder.input_blocks.0.linear1.weight")
    wide = {f"vae.{name}": torch.zeros(1, 60_000) for name in names}
    rest = {"global_motion_token": 2, "final_layer.weight": 150, "query_pos_encoder.pe": 500}
    state = wide | {f"vae.{name}": torch.zeros(size, 1) for name, size in rest.items()}
    torch.save({"state_dict": state}, tmp_path / "a.ckpt")
    with pytest.raises(LatentMotionError):
        convert_checkpoint(tmp_path / "a.ckpt", tmp_path / "out", Origin())
    assert not (tmp_path / "out").exists()
