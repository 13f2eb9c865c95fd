from __future__ import annotations

import hashlib
import json
import lzma
import shutil
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data import store
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.pack_coding import BoneCoder
from latentmotion.data.pack_file import unpack, unpacked
from latentmotion.data.packing import pack
from latentmotion.data.prepare import merge
from latentmotion.data.store import MANIFEST, StoredMotion, write_dataset
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.smpl import SMPL_FEATURES
from tests.support.moving_figures import write_moving_figures

HEAD = struct.Struct("<8s32sII")


@pytest.fixture(scope="module", autouse=True)
def short_shards() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "SHARD_FRAMES", 120)
        yield


@pytest.fixture(scope="module")
def made(short_shards: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of several shards, and its pack beside it."""
    place = tmp_path_factory.mktemp("made")
    merge([write_moving_figures(place / "made", train=6, val=2)], place / "set")
    pack(place / "set", place / "set.pack")
    return place


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made / "set", tmp_path / "set"))


@pytest.fixture
def packed(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copyfile(made / "set.pack", tmp_path / "set.pack"))


def every(dataset: Dataset) -> list[np.ndarray]:
    clips = [clip for split in ("train", "val", "test") for clip in dataset.clips(split)]
    return [dataset.features(clip) for clip in clips]


def test_a_folder_comes_back(folder: Path, packed: Path, tmp_path: Path) -> None:
    unpack(packed, tmp_path / "back")
    given, found = Dataset.load(folder), Dataset.load(tmp_path / "back")
    assert len(given.manifest.shards) > 2
    for name in ("clips", "sources", "normalizer", "representation", "fps"):
        assert getattr(found.manifest, name) == getattr(given.manifest, name)
    assert (tmp_path / "back" / "report.json").read_text() == (folder / "report.json").read_text()
    for before, after in zip(every(given), every(found), strict=True):
        joints = (HUMANML3D_FEATURES.decode(f.astype(np.float64)) for f in (before, after))
        assert np.linalg.norm(next(joints) - next(joints), axis=-1).max() < 0.0005
        difference = (after - before) / given.normalizer.std
        assert np.sqrt((difference**2).mean()) < 0.02
        contacts = HUMANML3D_FEATURES.blocks["contacts"]
        np.testing.assert_array_equal(before[:, contacts], after[:, contacts])


def test_it_is_small(folder: Path, packed: Path) -> None:
    features = sum(shard.stat().st_size for shard in folder.glob("*.safetensors"))
    assert packed.stat().st_size < features / 15


def test_packing_again_changes_nothing(packed: Path, tmp_path: Path) -> None:
    unpack(packed, tmp_path / "back")
    differences = pack(tmp_path / "back", tmp_path / "again.pack")
    assert differences.joints_mm < 1e-3
    assert differences.contacts == 0


def test_a_finer_quantum_is_more_exact(folder: Path, tmp_path: Path) -> None:
    coarse, fine = (pack(folder, tmp_path / f"{q}", q) for q in (0.0005, 0.0001))
    assert fine.joints_mm < coarse.joints_mm / 3 < 0.7 / 3
    assert (tmp_path / "0.0001").stat().st_size > (tmp_path / "0.0005").stat().st_size
    with pytest.raises(InputError, match="expected 1e-06 to"):
        pack(folder, tmp_path / "none", 0.0)


def test_features_of_a_part_keep_floor_and_heading(folder: Path, tmp_path: Path) -> None:
    """A piece cut from the air and from the middle of a turn is not put on the floor again."""
    dataset = Dataset.load(folder)
    clip = dataset.manifest.clips[0]
    features = dataset.features(clip.clip()).copy()
    features[:, HUMANML3D_FEATURES.blocks["root_height"]] += 0.7
    features[:, HUMANML3D_FEATURES.blocks["positions"]] += np.tile([0, 0.7, 0], 21)
    features[5, HUMANML3D_FEATURES.blocks["contacts"]] = [0, 1, 0, 1]
    normalizer = dataset.manifest.normalizer
    motion = StoredMotion(clip, features.astype(np.float32))
    write_dataset(tmp_path / "one", [motion], dataset.sources, HUMANML3D_FEATURES, normalizer)
    assert pack(tmp_path / "one", tmp_path / "one.pack").joints_mm < 0.5
    unpack(tmp_path / "one.pack", tmp_path / "back")
    (found,) = every(Dataset.load(tmp_path / "back"))
    np.testing.assert_allclose(found, features, atol=0.02)
    assert found[5, -4:].tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("size", [0.02, 0.3, 3.0])
def test_directions_stay_within_the_quantum(size: float) -> None:
    """However wildly a figure moves, errors do not grow along limbs or in time."""
    generator, frames = np.random.default_rng(1), np.array([40, 1, 7, 40])
    angles = generator.normal(0, size, (frames.sum(), 22, 3))
    root = generator.normal(0, 1, (frames.sum(), 3))
    joints = HUMANML3D.forward_kinematics(matrix_from_axis_angle(angles), root)
    coder = BoneCoder(HUMANML3D, 0.0005)
    numbers = coder.encode(joints, root, frames)
    found = coder.decode(numbers, root, frames)
    assert np.linalg.norm(found - joints, axis=-1).max() < 0.001


def test_a_data_set_opens_from_a_pack(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match=r"latentmotion data unpack .*set\.pack"):
        Dataset.load(packed)
    monkeypatch.setenv("LATENTMOTION_CACHE", str(tmp_path / "cache"))
    place = Dataset.load(packed).folder
    assert place.parent == tmp_path / "cache" / "data"
    assert [path.name for path in place.parent.iterdir()] == [place.name]
    before = (place / MANIFEST).stat().st_mtime_ns
    assert unpacked(packed) == place
    assert (place / MANIFEST).stat().st_mtime_ns == before


def test_commands(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("LATENTMOTION_CACHE", str(tmp_path / "cache"))
    main(["data", "pack", str(folder), "-o", str(tmp_path / "a.pack"), "--quantum", "0.5"])
    printed = capsys.readouterr().out
    assert "MB" in printed
    assert "0 contact labels differ" in printed
    main(["data", "check", str(tmp_path / "a.pack")])
    printed = capsys.readouterr().out
    assert "source synthetic\n  terms: CC0-1.0\n  credit: nobody" in printed
    main(["data", "unpack", str(tmp_path / "a.pack"), "-o", str(tmp_path / "b")])
    assert "synthetic" in capsys.readouterr().out
    assert len(Dataset.load(tmp_path / "b").clips("train")) == 6


def test_sources_and_terms_come_along(folder: Path, tmp_path: Path) -> None:
    dataset = Dataset.load(folder)
    sources = (Source("synthetic", "CC BY 4.0", "Ada and Grace", "https://example.org"),)
    motions = [StoredMotion(c, dataset.features(c.clip())) for c in dataset.manifest.clips]
    normalizer = dataset.manifest.normalizer
    write_dataset(tmp_path / "named", motions, sources, HUMANML3D_FEATURES, normalizer)
    pack(tmp_path / "named", tmp_path / "named.pack")
    unpack(tmp_path / "named.pack", tmp_path / "back")
    assert Dataset.load(tmp_path / "back").sources == sources


def test_other_bones_are_refused(folder: Path, tmp_path: Path) -> None:
    dataset = Dataset.load(folder)
    clip = dataset.manifest.clips[0]
    features = dataset.features(clip.clip()).copy()
    features[:, HUMANML3D_FEATURES.blocks["positions"]] *= 1.1
    normalizer = dataset.manifest.normalizer
    motion = StoredMotion(clip, features)
    write_dataset(tmp_path / "tall", [motion], dataset.sources, HUMANML3D_FEATURES, normalizer)
    with pytest.raises(DataError, match="its bones are not those of humanml3d"):
        pack(tmp_path / "tall", tmp_path / "tall.pack")
    assert not (tmp_path / "tall.pack").exists()


def rewritten(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """The pack with another header, its hash right."""
    content = path.read_bytes()
    _, _, size, _ = HEAD.unpack_from(content)
    header = json.loads(lzma.decompress(content[HEAD.size : HEAD.size + size]))
    change(header)
    plain = json.dumps(header).encode()
    return assembled(path, lzma.compress(plain), len(plain), content[HEAD.size + size :])


def assembled(path: Path, header: bytes, announced: int, blocks: bytes) -> Path:
    rest = struct.pack("<II", len(header), announced) + header + blocks
    path.write_bytes(b"LMPACK1\n" + hashlib.sha256(rest).digest() + rest)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h.update(format="latentmotion pack 9"), "update latentmotion"),
        (lambda h: h.update(surprise=1), "unknown key 'surprise'"),
        (lambda h: h.pop("manifest"), "missing key 'manifest'"),
        (lambda h: h.update(quantum=float("nan")), "contradicts itself"),
        (lambda h: h.update(quantum=1e9), "contradicts itself"),
        (lambda h: h.update(turn_quantum=-0.1), "contradicts itself"),
        (lambda h: h.update(blocks=[-5, 5]), "do not add up"),
        (lambda h: h["blocks"].__setitem__(0, 10**9), "do not add up"),
        (lambda h: h["manifest"].update(format="x"), "not 'latentmotion dataset 1'"),
        (lambda h: h["manifest"].update(representation="smpl"), "packs hold humanml3d and kit"),
        (lambda h: h["manifest"].update(representation="humanml4d"), "unknown representation"),
        (lambda h: h["manifest"]["shards"].pop(), "contradicts itself"),
        (lambda h: h["manifest"]["clips"][0].update(shard=99), "contradicts itself"),
        (lambda h: h["manifest"]["clips"][0].update(frames=-1), "contradicts itself"),
        (lambda h: h["manifest"]["clips"][0].update(frames=10**12), "contradicts itself"),
        (lambda h: h["manifest"]["clips"][0].update(frames=10**6), "announced"),
        (lambda h: h["manifest"]["clips"][0].update(frames=1), "announced"),
        (lambda h: h["manifest"]["clips"][0].update(frames=1.5), "expected int"),
        (lambda h: h["manifest"]["normalizer"].update(std=[1.0]), "expected 263"),
        (lambda h: h["manifest"]["normalizer"].update(std=[0.0] * 263), "std"),
        (lambda h: h["manifest"]["normalizer"].update(mean=[0.0] * 5), "263 numbers"),
    ],
)
def test_a_hostile_header(
    packed: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    with pytest.raises(FileFormatError, match=message):
        unpack(rewritten(packed, change), tmp_path / "back")
    assert not (tmp_path / "back").exists()


def test_two_clips_of_one_name(packed: Path, tmp_path: Path) -> None:
    def change(header: dict[str, Any]) -> None:
        clips = header["manifest"]["clips"]
        clips[0]["id"] = clips[1]["id"]

    with pytest.raises(DataError, match="two clips are called '001'"):
        unpack(rewritten(packed, change), tmp_path / "back")


def test_damage_is_found(packed: Path, tmp_path: Path) -> None:
    whole = packed.read_bytes()
    for content in (whole[:-1], whole[:60], whole + b"x", whole[:300] + b"?" + whole[301:]):
        packed.write_bytes(content)
        with pytest.raises(FileFormatError, match="damaged or cut off"):
            unpack(packed, tmp_path / "back")
    for content in (b"", b"LMPACK1\n", b"PK\x03\x04" + bytes(100)):
        packed.write_bytes(content)
        with pytest.raises(FileFormatError, match="no data pack"):
            unpack(packed, tmp_path / "back")
    with pytest.raises(InputError, match=r"it cannot be read: .*; expected a file"):
        unpack(tmp_path / "none.pack", tmp_path / "back")


def test_nothing_larger_than_announced_is_unpacked(packed: Path, tmp_path: Path) -> None:
    bomb = lzma.compress(bytes(50_000_000))
    with pytest.raises(FileFormatError, match="of the 1000 bytes that were announced"):
        unpack(assembled(packed, bomb, 1000, b""), tmp_path / "back")
    with pytest.raises(FileFormatError, match="at most 268435456 allowed"):
        unpack(assembled(packed, bomb, 2**32 - 1, b""), tmp_path / "back")
    greedy = lzma.compress(b"{}", preset=9)  # asks for 64 MiB to unpack two bytes
    with pytest.raises(FileFormatError, match="Memory usage limit"):
        unpack(assembled(packed, greedy, 2, b""), tmp_path / "back")
    with pytest.raises(FileFormatError, match="header cannot be unpacked"):
        unpack(assembled(packed, b"no xz at all", 12, b""), tmp_path / "back")


def test_random_motions_are_finite(packed: Path, tmp_path: Path) -> None:
    """Whatever numbers a block holds, they are some motion, or the pack is refused."""
    content = packed.read_bytes()
    size = HEAD.unpack_from(content)[2]
    header = json.loads(lzma.decompress(content[HEAD.size : HEAD.size + size]))
    generator, blocks = np.random.default_rng(0), []
    for shard in range(len(header["blocks"])):
        clips = [clip for clip in header["manifest"]["clips"] if clip["shard"] == shard]
        rows = sum(clip["frames"] + 1 for clip in clips)
        blocks.append(lzma.compress(generator.integers(0, 256, 93 * rows, np.uint8).tobytes()))
    header["blocks"] = [len(block) for block in blocks]
    plain = json.dumps(header).encode()
    unpack(assembled(packed, lzma.compress(plain), len(plain), b"".join(blocks)), tmp_path / "b")
    assert all(np.isfinite(features).all() for features in every(Dataset.load(tmp_path / "b")))


def test_features_of_actions_are_refused(folder: Path, tmp_path: Path) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["representation"] = SMPL_FEATURES.name
    (folder / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="packs hold humanml3d and kit"):
        pack(folder, tmp_path / "smpl.pack")
