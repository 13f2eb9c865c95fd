"""`latentmotion convert`: foreign files that are damaged, foreign or dangerous, and a good one."""

from __future__ import annotations

import os
import sys
import types
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from latentmotion.cli.convert import Convert
from latentmotion.cli.main import main
from latentmotion.convert import convert_checkpoint
from latentmotion.convert.mld import Origin
from latentmotion.convert.reading import read_checkpoint, rename
from latentmotion.errors import InputError, ModelError
from latentmotion.networks.checkpoint import load_model


def layer(prefix: str) -> dict[str, Tensor]:
    width, hidden = 8, 12
    shapes = {
        "self_attn.in_proj_weight": (3 * width, width),
        "self_attn.in_proj_bias": (3 * width,),
        "self_attn.out_proj.weight": (width, width),
        "self_attn.out_proj.bias": (width,),
        "linear1.weight": (hidden, width),
        "linear1.bias": (hidden,),
        "linear2.weight": (width, hidden),
        "linear2.bias": (width,),
        **{f"norm{i}.{kind}": (width,) for i in (1, 2) for kind in ("weight", "bias")},
    }
    return {f"{prefix}.{name}": torch.randn(shape) for name, shape in shapes.items()}


def frames_denoiser() -> dict[str, Tensor]:
    """The smallest network of the authors': diffusion on raw frames of 5 features, one layer."""
    shapes = {
        "pose_embd.weight": (8, 5),
        "pose_embd.bias": (8,),
        "pose_proj.weight": (5, 8),
        "pose_proj.bias": (5,),
        "time_embedding.linear_1.weight": (8, 6),
        "time_embedding.linear_1.bias": (8,),
        "time_embedding.linear_2.weight": (8, 8),
        "time_embedding.linear_2.bias": (8,),
        "emb_proj.1.weight": (8, 6),
        "emb_proj.1.bias": (8,),
        "query_pos.pe": (500, 1, 8),
        "mem_pos.pe": (500, 1, 8),
    }
    weights = {name: torch.randn(shape) for name, shape in shapes.items()}
    weights |= layer("encoder.layers.0")
    return {f"denoiser.{name}": tensor for name, tensor in weights.items()}


@pytest.fixture
def good(tmp_path: Path) -> Path:
    state = {**frames_denoiser(), "text_encoder.w": torch.zeros(2), "rot2xyz.smpl": torch.zeros(1)}
    torch.save({"state_dict": state, "hparams": {"lr": 1e-4}}, tmp_path / "good.ckpt")
    np.save(tmp_path / "Mean.npy", np.arange(5, dtype=np.float32))
    np.save(tmp_path / "Std.npy", np.ones(5, np.float32))
    return tmp_path / "good.ckpt"


def test_the_command_writes_a_folder(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = good.parent
    arrays = ["--mean", str(folder / "Mean.npy"), "--std", str(folder / "Std.npy")]
    main(["convert", str(good), "-o", str(folder / "model"), *arrays, "--heads", "2"])
    assert "rot2xyz (1: SMPL's body" in capsys.readouterr().out
    model = load_model(folder / "model")
    assert not model.card.vae.has_weights
    assert model.card.normalizer_mean == (0, 1, 2, 3, 4)
    assert model.card.latents.frames_per_token == 1
    assert list(model.card.provenance.data_hashes) == ["good.ckpt"]
    assert not any(name.startswith(("rot2xyz", "text")) for name in model.denoiser.state_dict())


class Dangerous:
    """Pickled code: unpickling it would make a file."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.trace),)


class Reduced:
    """Pickled as the call of a function."""

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


def save(content: Any) -> Callable[[Path], Any]:
    return lambda path: torch.save(content, path)


def renamed(old: str, new: str) -> Callable[[Path], Any]:
    weights = frames_denoiser()
    weights[f"denoiser.{new}"] = weights.pop(f"denoiser.{old}")
    return save({"state_dict": weights})


def truncated(path: Path) -> None:
    torch.save({"state_dict": frames_denoiser()}, path)
    path.write_bytes(path.read_bytes()[:-3000])


BAD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: None, "does not exist"),
    "empty": (lambda path: path.write_bytes(b""), "no PyTorch checkpoint, or is damaged"),
    "text": (lambda path: path.write_text("hello, this is text"), "damaged"),
    "folder": (lambda path: path.mkdir(), "no PyTorch checkpoint, or is damaged"),
    "truncated": (truncated, "damaged"),
    "array": (save(torch.zeros(3)), "no state_dict"),
    "no tensors": (save({"state_dict": {}}), "no state_dict"),
    "other network": (save({"state_dict": {"resnet.w": torch.zeros(1)}}), "found resnet"),
    "misspelt": (renamed("pose_proj.bias", "pose_prj.bias"), "unknown weights.*pose_prj"),
    "missing weight": (
        save({k: v for k, v in frames_denoiser().items() if "time" not in k}),
        "'time_embedding.linear_1.weight' are missing",
    ),
}


@pytest.mark.parametrize(("make", "message"), BAD.values(), ids=BAD)
def test_bad_files_are_refused(tmp_path: Path, make: Callable[[Path], Any], message: str) -> None:
    make(tmp_path / "bad.ckpt")
    plain = Origin((np.zeros(5), np.ones(5)))
    with pytest.raises(ModelError, match=message):
        convert_checkpoint(tmp_path / "bad.ckpt", tmp_path / "model", plain)
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("ending", [".npz", ".bvh", ".GLB"])
def test_a_motion_file_is_told_the_command_for_it(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"walk{ending}"
    path.write_bytes(b"PK")
    with pytest.raises(ModelError, match=r"is a motion file.*latentmotion clean .*walk"):
        convert_checkpoint(path, tmp_path / "model")


def test_code_inside_a_file_does_not_run(tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    torch.save({"state_dict": frames_denoiser(), "x": Dangerous(trace)}, tmp_path / "bad.ckpt")
    with pytest.raises(ModelError, match="could run code"):
        convert_checkpoint(tmp_path / "bad.ckpt", tmp_path / "model")
    assert not trace.exists()
    assert not (tmp_path / "model").exists()


# Stands for OmegaConf's class, which is in the authors' files.
SETTINGS = """
class DictConfig:
    def __init__(self, content):
        self.content, self.parent = content, None
"""


def save_with_settings(path: Path, state: dict[str, Tensor], monkeypatch: Any) -> None:
    module = types.ModuleType("omegaconf.dictconfig")
    exec(SETTINGS, module.__dict__)
    module.DictConfig.__module__ = module.__name__
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "omegaconf", types.ModuleType("omegaconf"))
        patch.setitem(sys.modules, "omegaconf.dictconfig", module)
        settings = module.DictConfig({"lr": 1e-4, "path": Path("x"), "score": np.float64(2)})
        content = {
            "state_dict": OrderedDict(state),
            "hyper_parameters": settings,
            "callbacks": {"best": defaultdict(list), "half": torch.ones(3).half()},
        }
        torch.save(content, path)


def test_settings_of_foreign_programs_do_not_matter(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = frames_denoiser()
    state["denoiser.pose_proj.bias"] = torch.arange(10.0)[::2]  # a view with a stride
    state["denoiser.pose_proj.weight"] = torch.nn.Parameter(torch.randn(5, 8))
    save_with_settings(good.parent / "with.ckpt", state, monkeypatch)
    assert "omegaconf" not in sys.modules
    found = read_checkpoint(good.parent / "with.ckpt")
    assert found.keys() == state.keys()
    assert all(torch.equal(found[key], tensor) for key, tensor in state.items())
    plain = Origin((np.zeros(5), np.ones(5)), heads=2)
    convert_checkpoint(good.parent / "with.ckpt", good.parent / "model", plain)
    assert "omegaconf" not in sys.modules


@pytest.mark.parametrize("kind", ["call", "eval", "object of settings", "old format"])
def test_code_beside_settings_does_not_run(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    trace, file = tmp_path / "trace", tmp_path / "bad.ckpt"
    content: Any = {"state_dict": frames_denoiser(), "path": Path("x"), "x": Dangerous(trace)}
    if kind == "eval":
        content["x"] = Reduced(eval, (f"__import__('os').mkdir({str(trace)!r})",))
    if kind == "object of settings":
        content["x"] = Reduced(defaultdict, (Dangerous(trace),))
    torch.save(content, file, _use_new_zipfile_serialization=kind != "old format")
    with pytest.raises(ModelError, match="could run code"):
        convert_checkpoint(file, tmp_path / "model")
    assert not trace.exists()
    assert not (tmp_path / "model").exists()


def test_a_tensor_beyond_its_storage_is_refused(tmp_path: Path) -> None:
    class Beyond:
        def __reduce__(self) -> Any:
            storage = torch.zeros(2).untyped_storage()
            typed = torch.storage.TypedStorage(
                wrap_storage=storage, dtype=torch.float32, _internal=True
            )
            return torch._utils._rebuild_tensor_v2, (typed, 0, (9,), (1,), False, OrderedDict())

    content = {"state_dict": {"denoiser.x": Beyond()}, "path": Path("x")}
    torch.save(content, tmp_path / "bad.ckpt")
    with pytest.raises(ModelError):
        read_checkpoint(tmp_path / "bad.ckpt")


def test_the_normalizer_must_come_along(good: Path) -> None:
    with pytest.raises(InputError, match=r"--mean Mean\.npy"):
        convert_checkpoint(good, good.parent / "model")
    with pytest.raises(InputError, match="4 means"):
        convert_checkpoint(good, good.parent / "model", Origin((np.zeros(4), np.ones(5))))
    with pytest.raises(InputError, match="belong together"):
        Convert(good, good.parent / "model", mean=good.parent / "Mean.npy").run()
    (good.parent / "Mean.npy").write_text("no array")
    with pytest.raises(InputError, match="not a readable"):
        Convert(
            good, good.parent / "model", good.parent / "Mean.npy", good.parent / "Std.npy"
        ).run()
    assert not (good.parent / "model").exists()


def test_a_sine_table_must_be_one() -> None:
    with pytest.raises(ModelError, match="sine"):
        rename({"query_pos_encoder.pe": torch.zeros(5000, 1, 8)}, ((r"query.*", "x.table"),))
