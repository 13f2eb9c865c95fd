"""Every reader and mutated files: finite valid data or our own error, and no other exception.

Time and memory of each file are bounded. Seeds are fixed; LATENTMOTION_FUZZ_SEED names another.
LATENTMOTION_FUZZ=N tries N inputs for each reader in place of a few, and N/10 for those that are
slow, as USD, which a process reads.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import os
import random
import shutil
import signal
import sqlite3
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch
from pydantic import ValidationError
from safetensors.numpy import save_file

from latentmotion import formats
from latentmotion.bulk import read_rows
from latentmotion.control.scene import read_scene
from latentmotion.convert.reading import read_checkpoint
from latentmotion.data.clip import Source, fit_sentences, parse_sentences
from latentmotion.data.dataset import Dataset
from latentmotion.data.pack_file import unpack
from latentmotion.data.packing import pack
from latentmotion.data.sources.actor import humanact12_recordings
from latentmotion.data.sources.humanml3d import read_texts
from latentmotion.data.sources.own import OwnMotions
from latentmotion.engine.lengths import LengthModel
from latentmotion.errors import LatentMotionError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.formats.keypoints import KeypointOptions, read_keypoints
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.card import find_model, read_card
from latentmotion.motion import Motion
from latentmotion.networks.checkpoint import read_weights
from latentmotion.retarget import read_rig, transfer
from latentmotion.retrieval.index import read_index
from latentmotion.retrieval.wordings import read_wordings
from latentmotion.storage.configuration import read_plain, write_json
from latentmotion.studio.library import Edits, Library
from latentmotion.studio.projects import write as write_project
from latentmotion.studio.schemas import Project
from latentmotion.study.design import KEY_FORMAT, KeyPair, StudyKey
from latentmotion.study.report import read_key
from tests.support import damaged
from tests.support.action_files import write_humanact12
from tests.support.moving_figures import write_moving_figures
from tests.support.synthetic_smpl import write_synthetic_smpl
from tests.support.walker import walker

resource = pytest.importorskip("resource", reason="limits of a process are POSIX's")

INPUTS = int(os.environ.get("LATENTMOTION_FUZZ", "6"))
SEED = os.environ.get("LATENTMOTION_FUZZ_SEED", "13")

SECONDS = 20.0  # Processor time of one file; all of these are small.

# Bytes that reading a file may take, however small it is, and for each of its bytes.
MEMORY, FACTOR = 1 << 28, 1000

PIECES = [
    *(b"nan", b"inf", b"-1", b"0", b"1e999", b"1e-320", b"99999999999", b"null", b"[]", b"{}"),
    *(b"\xff\xfe", b"\0", b'"', b"\n", b"#", b"{", b"}", b"true", b"1e30", b"-0.0"),
    *(struct.pack("<I", n) for n in (0, 1, 0x7FFFFFFF, 0xFFFFFFFF)),
    *(struct.pack("<d", x) for x in (np.nan, np.inf, 1e300, 1e-320)),
    *(struct.pack("<f", x) for x in (np.nan, np.inf, 1e30)),
]


def mutated(content: bytes, draw: random.Random) -> bytes:
    """Bytes with some cut, doubled, flipped, or exchanged for others that readers fear."""
    data = bytearray(content)
    for _ in range(draw.choice((1, 1, 2, 4))):
        at = draw.randrange(len(data) + 1)
        if draw.random() < 0.5:  # heads and lists at the end decide most
            at = draw.choice((at % 300, max(len(data) - at % 300, 0)))
        end = min(at + draw.choice((1, 2, 4, 8, 40, 400)), len(data))
        match draw.randrange(6):
            case 0:
                del data[at:end]
            case 1:
                data[at:at] = data[at:end] * draw.choice((1, 2, 20))
            case 2:
                data[at:end] = draw.randbytes(end - at)
            case 3:
                piece = draw.choice(PIECES)
                data[at : at + len(piece)] = piece
            case 4:
                data[at:at] = draw.choice(PIECES)
            case 5 if at < len(data):
                data[at] ^= 1 << draw.randrange(8)
    return bytes(data if draw.random() > 0.1 else data[: draw.randrange(len(data) + 1)])


def finite(*values: object) -> None:
    for value in values:
        assert np.isfinite(np.asarray(value, np.float64)).all()


def load_motions(path: Path) -> None:
    for motion in formats.load(path):
        finite(motion.joints, motion.fps, motion.skeleton.offsets)
        json.dumps(dict(motion.metadata), allow_nan=False)


def load_asf(path: Path) -> None:
    animation = read_asf_amc(path.with_suffix(".amc"), path.with_suffix(".asf"))
    finite(animation.joints(), animation.fps)


def load_gltf(path: Path) -> None:
    for animation in read_animations(path):
        finite(animation.joints(), animation.fps)


def load_dataset(path: Path) -> None:
    dataset = Dataset.load(path.parent)
    finite(dataset.normalizer.mean, dataset.normalizer.std)
    for clip in dataset.clips("train") + dataset.clips("val"):
        finite(dataset.features(clip))


def load_pack(path: Path) -> None:
    content = path.read_bytes()  # as of somebody who knows the hash
    path.write_bytes(content[:8] + hashlib.sha256(content[40:]).digest() + content[40:])
    target = path.parent / "unpacked"
    shutil.rmtree(target, ignore_errors=True)
    unpack(path, target)


def zipped(path: Path, folder: Path, target: Path) -> Path:
    """Packs a folder again, whose check sums are right then."""
    with zipfile.ZipFile(target, "w") as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder))
    return target


def load_member(path: Path) -> None:
    load_motions(zipped(path, path.parent, path.parents[1] / "again.npz"))


def load_tensors(path: Path) -> None:
    read_checkpoint(zipped(path, path.parents[1], path.parents[2] / "again.ckpt"))


def load_captions(path: Path) -> None:
    (path.parent / "a.bvh").write_text("no motion")
    source = Source("own", "mine", "me")
    list(OwnMotions(path.parent, source, path if path.suffix == ".csv" else None).recordings())
    fit_sentences(parse_sentences(path.read_text("utf-8", "replace")), 40)


def load_weights(path: Path) -> None:
    for tensor in read_weights(path).values():
        assert tensor.nbytes <= path.stat().st_size


def load_actions(path: Path) -> None:
    for item in humanact12_recordings(path, 60):
        finite(getattr(item, "features", 0))


def load_body(path: Path) -> None:
    body = load_smpl(path)
    finite(body.body.template, body.body.weights, body.skeleton.offsets)


def load_rig(path: Path) -> None:
    """Reads a character and writes a motion on it."""
    rig = read_rig(path)
    motion = Motion(walker(6).joints().astype("f4"))
    for file in transfer.write(path.with_name(f"moved{path.suffix}"), rig, [motion], None):
        read_rig(file)


def load_library(path: Path) -> None:
    """Opens a library and reads all of it, as the studio does; SQLite's errors are answered."""
    for log in path.parent.glob(f"{path.name}-*"):
        log.unlink()
    library = Library(path.parent)
    try:
        for take in library.takes(tag="x")[1] + library.takes(query="a")[1] + library.takes()[1]:
            json.dumps(take.about(), allow_nan=False)
            if not take.damaged:
                library.motion(take)
        library.tags()
        for character in library.characters():
            json.dumps(character.about(), allow_nan=False)
    except sqlite3.Error:
        pass
    finally:
        library.close()


def load_scheduled(path: Path) -> None:
    schedule = read_card(path.parent).schedule
    finite(schedule.alpha(1), schedule.sigma(1))


def load_keypoints(path: Path) -> None:
    stated = KeypointOptions(fps=30.0)
    keypoints = read_keypoints(path.parent if path.parent.name == "openpose" else path, stated)
    finite(keypoints.confidence, keypoints.fps)


def load_moves(path: Path) -> None:
    packed = path.with_suffix(".index")
    packed.write_bytes(zlib.compress(path.read_bytes(), 1))
    read_index(packed)


def load_lengths(path: Path) -> None:
    model = LengthModel.read(path)
    finite(*model.weights, *model.biases)


def load_project(path: Path) -> None:
    """Reads a project as the studio does, and writes what it read."""
    content = read_plain(path)
    with suppress(ValidationError):  # the studio answers by 422
        write_project(path.parent, "b", Project.model_validate(content).model_dump())


USD = ("a.usda", "a.usdc", "a.usdz")
SLOW = (*USD, "moves.plain")  # A process, or half a second, for each input.

READERS: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(("a.bvh", "a.csv", "a.npz", "a.npy", "a.amass.npz", "a.vrma"), load_motions),
    **dict.fromkeys(USD, load_motions),
    **dict.fromkeys(("bones.glb", "bones.gltf", "ours.glb"), load_gltf),
    **dict.fromkeys(("rig.glb", "rig.gltf", "rig.bvh"), load_rig),
    "library/library.sqlite3": load_library,
    "scene.json": read_scene,
    "projects/a.json": load_project,
    "study.key.json": read_key,
    **dict.fromkeys(("points.json", "points.npz", "points.csv", "openpose/0.json"), load_keypoints),
    "map.json": load_joint_map,
    "moves.plain": load_moves,
    "lengths.safetensors": load_lengths,
    **dict.fromkeys(("prompts.csv", "prompts.txt"), read_rows),
    "wordings.tsv": lambda path: read_wordings([path]),
    "scheduled/model.json": load_scheduled,
    **dict.fromkeys(("figure/a.asf", "figure/a.amc"), load_asf),
    **dict.fromkeys(("data/manifest.json", "data/motions-000.safetensors"), load_dataset),
    **dict.fromkeys(("captions/captions.csv", "captions/a.txt"), load_captions),
    "data.lmpack": load_pack,
    "card/model.json": lambda path: read_card(path.parent),
    "card/weights.safetensors": load_weights,
    **dict.fromkeys(("new.ckpt", "old.ckpt"), read_checkpoint),
    "new/archive/data.pkl": load_tensors,
    **dict.fromkeys(("members/joints.npy", "members/metadata.npy"), load_member),
    **dict.fromkeys(("members/frames.npy", "members/parents.npy"), load_member),
    "poses.pkl": load_actions,
    **dict.fromkeys(("body.pkl", "body.npz"), load_body),
    "texts/texts.json.xz": lambda path: read_texts(path.parent),
}


def write_texts(folder: Path, motion: Motion) -> None:
    """Writes keypoints, a joint map, prompts, a project and the like."""
    points = motion.joints.round(3).astype(float)
    (folder / "points.json").write_text(json.dumps({"fps": 20, "points": points.tolist()}))
    np.savez(folder / "points.npz", points=points, fps=20.0, names=motion.skeleton.names)
    head = ["time", *(f"{name}_{axis}" for name in motion.skeleton.names for axis in "xyz")]
    rows = [[n / 20, *frame.ravel()] for n, frame in enumerate(points)]
    (folder / "points.csv").write_text("\n".join(",".join(map(str, row)) for row in [head, *rows]))
    people = [{"pose_keypoints_2d": [*range(2), 0.5] * 25}]
    for name in ("0.json", "1.json"):
        (folder / "openpose" / name).write_text(json.dumps({"people": people}))
    (folder / "map.json").write_text('{"pelvis": "Hips", "spine1": {"Spine": 0.5, "Chest": 0.5}}')
    (folder / "prompts.csv").write_text("prompt,seconds,seed\na person walks,2.5,3\n")
    (folder / "prompts.txt").write_text("a person walks\na person jumps\n")
    (folder / "wordings.tsv").write_text("a person walks\tstroll|go for a walk\n")
    span = {"prompt": "a walk", "seconds": 2.0}
    project = {"format": 1, "timeline": [span], "settings": {"a": [1, {"b": None}]}}
    (folder / "projects" / "a.json").write_text(json.dumps(project))
    pairs = (KeyPair("p", "a walk", 0, "A"),)
    key = StudyKey(KEY_FORMAT, "s", "A", "B", 3, {"which": "Which?"}, pairs)
    write_json(folder / "study.key.json", key)
    shutil.copy(find_model("starter") / "lengths.safetensors", folder)
    packed = (find_model("starter") / "moves.index").read_bytes()
    (folder / "moves.plain").write_bytes(zlib.decompress(packed))


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """One valid file for every reader."""
    folder = tmp_path_factory.mktemp("valid")
    for name in ("figure", "captions", "card", "texts", "new", "openpose", "projects"):
        (folder / name).mkdir()
    motion = Motion(walker(6).joints().astype("f4"), caption="a person walks")
    usd = USD if find_spec("pxr") else ()
    for name in ("a.bvh", "a.csv", "a.npz", "a.amass.npz", "a.vrma", "ours.glb", *usd):
        motion.save(folder / name)
    write_texts(folder, motion)
    np.save(folder / "a.npy", motion.joints)
    skeleton = replace(motion.skeleton, name="other", names=tuple(f"n{i}" for i in range(22)))
    replace(motion, skeleton=skeleton).save(folder / "other.npz")
    with zipfile.ZipFile(folder / "other.npz") as archive:
        archive.extractall(folder / "members")
    damaged.gltf(folder / "bones.glb")
    motion.save(folder / "bones.gltf")
    for ending in ("glb", "gltf", "bvh"):
        Motion(walker(6).joints().astype("f4")).save(folder / f"rig.{ending}")
    library = Library(folder / "library")
    library.add([(motion, {"prompt": "a person walks", "model": "x"}, "walk", Edits())] * 3)
    with library._written() as database:
        database.execute("UPDATE takes SET tags = '[\"x\"]', goals = '[{\"goal\": {}}]'")
        row = "0" * 26, "Ann", "glb", '{"bones": ["a"], "mapping": {"pelvis": "a"}}', 0
        database.execute("INSERT INTO characters VALUES (?, ?, ?, ?, ?)", row)
    library.close()
    scene = {
        **{"format": 1, "prompt": "a walk", "seconds": 4.0, "seed": 3},
        **{"goals": [{"joint": "head", "at": 1.0, "to": [0, None, 1.5]}]},
        **{"path": {"points": [[0, 0], [1, 2]], "at": [0.0, 3.5]}},
        "headings": [{"at": 1, "degrees": 90}],
    }
    (folder / "scene.json").write_text(json.dumps(scene))
    (folder / "scheduled").mkdir()
    card = json.loads((find_model("starter") / "model.json").read_text())
    card["schedule"] = {"kind": "ScaledLinear", "start": 0.00085, "end": 0.012, "length": 1000}
    (folder / "scheduled" / "model.json").write_text(
        json.dumps({"schedule": card.pop("schedule"), **card})
    )
    damaged.asf(folder / "figure" / "a.asf")
    write_moving_figures(folder / "data", train=1, val=1)
    pack(folder / "data", folder / "data.lmpack")
    (folder / "captions" / "captions.csv").write_text("file,caption,from,to\na,he waves,0,1.5\n")
    (folder / "captions" / "a.txt").write_text("he waves.#he/PRON wave/VERB#0.0#1.5\nhe stops\n")
    shutil.copy(find_model("starter") / "model.json", folder / "card")
    save_file({"vae.a": np.ones((3, 4), "f4")}, folder / "card" / "weights.safetensors")
    state = {"state_dict": {"vae.a": torch.ones(3, 4), "vae.b": torch.ones(4)}, "epoch": 3}
    torch.save(state, folder / "new.ckpt")
    with zipfile.ZipFile(folder / "new.ckpt") as archive:
        archive.extractall(folder / "new")
    (folder / "new" / archive.namelist()[0].split("/")[0]).rename(folder / "new" / "archive")
    torch.save(state, folder / "old.ckpt", _use_new_zipfile_serialization=False)
    write_humanact12(folder / "poses.pkl", frames=(4, 5), actions=(1, 2))
    for name in ("body.pkl", "body.npz"):
        write_synthetic_smpl(folder / name)
    (folder / "texts" / "texts.json.xz").write_bytes(lzma.compress(b'{"000001": "he waves"}'))
    yield folder


class TooSlowError(BaseException):
    """A file took too long; no reader takes it for damage."""


def too_slow(*signal: object) -> None:
    raise TooSlowError


@contextmanager
def bounded(size: int) -> Iterator[None]:
    """Fails if what is inside takes too much processor time or memory for a file of a size."""
    most = MEMORY + FACTOR * size
    limits = resource.getrlimit(resource.RLIMIT_AS)
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before, peak = resident(), resident("VmHWM")
    handler = signal.signal(signal.SIGVTALRM, too_slow)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    resource.setrlimit(resource.RLIMIT_AS, (mapped + 8 * most, limits[1]))
    try:
        yield
    except TooSlowError:
        raise AssertionError(f"not read in {SECONDS:g} s of processor time") from None
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, limits)
    taken = resident("VmHWM") - before
    assert taken <= most or resident("VmHWM") == peak, (
        f"{taken:,} bytes of memory for a file of {size:,}"
    )


def resident(kind: str = "VmRSS") -> int:
    """Returns bytes of memory that this process has, or had at most since the last reset."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(f"{kind}:"))


@pytest.mark.parametrize("name", READERS)
def test_mutations(name: str, valid: Path, tmp_path: Path) -> None:
    if name in SLOW and "LATENTMOTION_FUZZ" not in os.environ:
        pytest.skip("a second for each file; set LATENTMOTION_FUZZ")
    inputs = -(-INPUTS // 10) if name in SLOW else INPUTS
    content, read = (valid / name).read_bytes(), READERS[name]
    place = tmp_path / name
    if place.parent == tmp_path:
        shutil.copy(valid / name, place)
    else:
        shutil.copytree((valid / name).parent, place.parent)
    read(place)
    draw = random.Random(f"{name} {SEED}")
    for number in range(inputs):
        place.write_bytes(mutated(content, draw))
        try:
            with warnings.catch_warnings(), bounded(place.stat().st_size):
                warnings.simplefilter("ignore", UserWarning)  # torch's, of old files
                read(place)
        except LatentMotionError:
            continue
        except Exception as error:
            kept = shutil.copy(place, f"{tmp_path}/found-{number}{place.suffix}")
            raise AssertionError(f"input {number} of {name}, kept as {kept}: {error!r}") from error
