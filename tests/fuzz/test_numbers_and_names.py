"""Numbers, names and addresses of files that are far too large: an error, at once."""

from __future__ import annotations

import json
import shutil
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tokenizers import Tokenizer

from latentmotion import MotionPipeline, formats
from latentmotion.control.scene import read_scene
from latentmotion.diffusion.schedule import Cosine, ScaledLinear
from latentmotion.engine.encoder import load_text_encoder
from latentmotion.errors import FileFormatError, InputError, LatentMotionError, ModelError
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.card import find_model
from latentmotion.motion import Motion
from latentmotion.ranking.scorer import Scorer
from latentmotion.retarget import read_rig, transfer
from latentmotion.storage.array_files import read_arrays
from tests.support import damaged
from tests.support.synthetic_smpl import write_synthetic_smpl
from tests.support.walker import walker


@pytest.fixture(scope="module")
def figure(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Returns a figure as glTF's JSON."""
    path = tmp_path_factory.mktemp("figure") / "a.gltf"
    Motion(walker(12).joints().astype("f4"), caption="walks").save(path)
    return json.loads(path.read_text())


@pytest.mark.parametrize("kind", [ScaledLinear, Cosine])
@pytest.mark.parametrize("length", [0, -1, 10**6, 10**12])
def test_a_schedule_of_absurd_length(kind: type, length: int) -> None:
    with pytest.raises(InputError, match=r"schedule\.length"):
        kind(length=length)


def test_a_tokenizer_of_another_encoder(tmp_path: Path) -> None:
    source = find_model("starter")
    for name in ("text_encoder.onnx", "tokenizer.json"):
        shutil.copy(source / name, tmp_path)
    path = tmp_path / "tokenizer.json"
    content = json.loads(path.read_text())
    vocabulary = content["model"]["vocab"]
    vocabulary["walks"] = 10**6
    path.write_text(json.dumps(content))
    assert 10**6 in Tokenizer.from_file(str(path)).encode("a person walks").ids
    with pytest.raises(ModelError, match="do not belong together"):
        load_text_encoder(tmp_path)(["a person walks"])


def test_a_scorer_whose_weights_are_damaged(monkeypatch: pytest.MonkeyPatch) -> None:
    scorer = Scorer.load()

    class Broken:
        def __call__(self, **inputs: np.ndarray) -> np.ndarray:
            (first, *_) = inputs.values()
            return np.full((len(first), scorer.card.width), np.nan, np.float32)

    for tower in ("text_tower", "motion_tower"):
        monkeypatch.setitem(scorer.__dict__, tower, Broken())
    with pytest.raises(ModelError, match="weights are damaged"):
        scorer.texts(["a person walks"])
    with pytest.raises(ModelError, match="weights are damaged"):
        scorer.motions([Motion(walker(30).joints().astype("f4"))])


def test_names_of_ten_million_letters(figure: dict[str, Any], tmp_path: Path) -> None:
    content = json.loads(json.dumps(figure))
    content["nodes"][content["skins"][0]["joints"][3]]["name"] = "LeftLeg" * 1_500_000
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    began = time.process_time()
    for read in (read_animations, read_rig):
        with pytest.raises(LatentMotionError, match="letters"):
            read(tmp_path / "a.gltf")
    assert time.process_time() - began < 20


@pytest.mark.parametrize("place", ["buffers", "images"])
def test_addresses_of_thousands_of_letters(
    figure: dict[str, Any], place: str, tmp_path: Path
) -> None:
    for address in ("a" * 300, "b/" * 2000, "c" * 5000):
        content = json.loads(json.dumps(figure))
        content[place] = [*content.get(place, []), {}]
        content[place][0]["uri"] = address
        content[place] = content[place][:1]
        (tmp_path / "a.gltf").write_text(json.dumps(content))
        with pytest.raises(FileFormatError, match=r"a\.gltf"):
            read_animations(tmp_path / "a.gltf")


WRONG: list[tuple[str, Any]] = [
    *(("animations", it) for it in (["x"], None, 5, {}, [[]], [{"name": ["x"]}], [None])),
    *(("bufferViews", it) for it in (5, None, {}, ["x"])),
    *(("accessors", it) for it in (5, None, {}, ["x"])),
    *(("nodes", it) for it in (5, None, {}, ["x"])),
    *(("asset", it) for it in (5, None, [], "x")),
]


@pytest.mark.parametrize(("key", "value"), WRONG)
def test_glb_of_other_types_is_retargeted_or_refused(
    figure: dict[str, Any], key: str, value: Any, tmp_path: Path
) -> None:
    motion = Motion(walker(12).joints().astype("f4"))
    (tmp_path / "a.gltf").write_text(json.dumps(figure | {key: value}))
    try:
        rig = read_rig(tmp_path / "a.gltf")
        transfer.write(tmp_path / "b.glb", rig, [motion], None)
    except LatentMotionError:
        assert not (tmp_path / "b.glb").exists()


@pytest.mark.parametrize(
    ("scene", "told"),
    [
        ({"goals": [{"joint": "head", "at": 1, "to": [0, 1, 0]}] * 1_000}, "1,000 goals"),
        ({"path": {"points": [[0, 0]] * 1_000}}, "a path of 1,000 points"),
        ({"timeline": [{"prompt": "a walk"}] * 17}, "17 timeline"),
    ],
)
def test_scenes_are_bounded_as_in_the_service(
    scene: dict[str, Any], told: str, tmp_path: Path
) -> None:
    (tmp_path / "a.json").write_text(json.dumps({"format": 1, **scene}))
    with pytest.raises(InputError, match=told):
        read_scene(tmp_path / "a.json")


def test_arrays_of_one_name(tmp_path: Path) -> None:
    path = damaged.arrays(tmp_path / "a.npz")
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("joints.npy", archive.read("joints.npy"))
    with pytest.raises(FileFormatError, match="two arrays of one name"):
        read_arrays(path, ["joints"])


def test_smpl_files_without_a_part(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", poses=np.zeros((3, 156)), mocap_framerate=30.0, trans=["x"])
    with pytest.raises(LatentMotionError):
        formats.load(tmp_path / "a.npz")
    write_synthetic_smpl(tmp_path / "body.npz")
    with np.load(tmp_path / "body.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    table = arrays["kintree_table"].astype(np.float64)
    table[0, 3] = np.nan
    np.savez(tmp_path / "nan.npz", **arrays | {"kintree_table": table})
    with pytest.raises(FileFormatError, match="not finite"):
        load_smpl(tmp_path / "nan.npz")


def test_a_model_whose_schedule_hangs_is_refused(tmp_path: Path) -> None:
    shutil.copytree(find_model("starter"), tmp_path / "model")
    card = json.loads((tmp_path / "model" / "model.json").read_text())
    card["schedule"] = {"kind": "ScaledLinear", "length": 10**9}
    (tmp_path / "model" / "model.json").write_text(json.dumps(card))
    with pytest.raises(ModelError, match=r"schedule\.length 1,000,000,000: expected 1 to 100,000"):
        MotionPipeline.from_pretrained(str(tmp_path / "model"))
