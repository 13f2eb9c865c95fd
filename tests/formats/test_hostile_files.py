"""Hostile files cost no memory and no time, and are told as errors of the file."""

from __future__ import annotations

import csv
import json
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import FileFormatError, InputError, LatentMotionError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.formats.bvh import read_bvh
from latentmotion.formats.gltf_document import Document
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.motion import Motion
from tests.support import damaged
from tests.support.walker import walker


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    """Lets a reader take no more than one gigabyte."""
    resource = pytest.importorskip("resource", reason="limits of a process are POSIX's")
    before = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + (1 << 30), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


ZEROS = bytes(120_000_000)
POSES = {"trans": damaged.header((1, 3)) + bytes(12)}

NPZ: dict[str, Callable[[Path], Path]] = {
    "joints unpack to a thousand times": lambda p: damaged.npz(
        p, {"names": b"", "joints": damaged.header((454545, 22, 3)) + ZEROS}
    ),
    "poses unpack to a thousand times": lambda p: damaged.npz(
        p, POSES | {"poses": damaged.header((192307, 156)) + ZEROS}
    ),
    "a header that says more": lambda p: damaged.npz(
        p, {"names": b"", "joints": damaged.header((10**12, 22, 3))}
    ),
    "a dtype of objects": lambda p: damaged.npz(p, {"names": damaged.header((1,), "|O")}),
    "a dtype of dates": lambda p: damaged.npz(p, {"names": damaged.header((1,), "<M8[s]")}),
    "text instead of joints": lambda p: damaged.arrays(p, joints=np.array(["a", "b"])),
    "metadata nested deep": lambda p: damaged.arrays(p, metadata=np.array(["[" * 10**5])),
    "metadata with NaN": lambda p: damaged.arrays(p, metadata=np.array(['{"a": NaN}'])),
    "metadata that are a list": lambda p: damaged.arrays(p, metadata=np.array(["[1]"])),
    "takes that do not add up": lambda p: damaged.arrays(p, frames=np.array([7])),
    "a rate of 1e-320": lambda p: damaged.arrays(p, fps=np.array([1e-320])),
    "joints in the next galaxy": lambda p: damaged.arrays(p, joints=np.full((3, 22, 3), 1e30)),
    "a bone that is its own parent": lambda p: damaged.arrays(
        p, names=np.array([f"n{i}" for i in range(22)]), parents=np.arange(22)
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", NPZ)
def test_npz(kind: str, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"a\.npz: "):
        formats.load(NPZ[kind](tmp_path / "a.npz"))


def test_an_array_that_nobody_asked_for_is_not_unpacked(tmp_path: Path) -> None:
    path = damaged.arrays(tmp_path / "a.npz")
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("more.npy", damaged.header((30_000_000,)) + ZEROS)
    assert len(formats.load(path)[0]) == 3


def test_encrypted_and_cut_members(tmp_path: Path) -> None:
    content = bytearray(damaged.arrays(tmp_path / "a.npz").read_bytes())
    at = content.index(b"PK\x01\x02")
    while at >= 0:  # the flag of every entry in the list at the end
        content[at + 8] |= 1
        at = content.find(b"PK\x01\x02", at + 4)
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(FileFormatError, match="encrypted"):
        formats.load(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "content",
    [
        damaged.header((10**12, 22, 3)),
        damaged.header((3, 22, 3)).replace(b"(3,", b"((((")[:90],
        damaged.header((3, 22, 3)).replace(b"'<f4'", b"'V8' "),
        b"\x93NUMPY\x01\x00\x10\x00{'descr': '''\n  \n",
    ],
)
def test_npy(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"a\.npy: "):
        formats.load(tmp_path / "a.npy")


def accessor(**changes: object) -> dict[str, list[dict[str, object]]]:
    entry = {"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"}
    turns = entry | {"bufferView": 1, "type": "VEC4"}
    times = {key: value for key, value in (entry | changes).items() if value is not None}
    return {"accessors": [times, turns]}  # type: ignore[dict-item]


def chain(count: int) -> dict[str, list[dict[str, object]]]:
    return {"nodes": [{"children": [n + 1]} for n in range(count - 1)] + [{}]}


GLTF = {
    "10^12 zeros": accessor(bufferView=None, count=10**12),
    "a stride of 0": {
        "bufferViews": [
            {"buffer": 0, "byteLength": 8, "byteStride": 0},
            {"buffer": 0, "byteOffset": 8, "byteLength": 32},
        ]
    }
    | accessor(count=10**9),
    "a chain of 20,000 nodes": chain(20_000) | {"skins": [{"joints": [0, 19_999]}]},
    "a count that is true": accessor(count="2"),
    "an asset that is a list": {"asset": []},
    "nodes that are numbers": {"nodes": [1, 2, 3]},
    "a node before the first": {"nodes": [{"children": [-1]}, {}, {}]},
    "names that are far away": {"nodes": [{"translation": [1e300, 0, 0], "children": [1]}, {}, {}]},
    "a number of 400 digits": {"nodes": [{"translation": [10**400, 0, 0]}, {}, {}]},
}


@pytest.mark.parametrize("kind", GLTF)
def test_gltf(kind: str, tmp_path: Path) -> None:
    path = damaged.gltf(tmp_path / "a.glb", **GLTF[kind])
    with pytest.raises(FileFormatError, match=r"a\.glb"):
        read_animations(path)


def test_the_glb_of_these_tests_is_read_undamaged(tmp_path: Path) -> None:
    assert len(read_animations(damaged.gltf(tmp_path / "a.glb"))[0]) == 2


@pytest.mark.parametrize(
    "text",
    ['{"asset":' * 10**5, '{"asset": NaN}', '{"asset": 1e999}', "[" * 500 + "]" * 500, "\xff"],
)
def test_json_of_other_kinds(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_bytes(text.encode("latin1"))
    with pytest.raises(FileFormatError, match="JSON"):
        Document.read(tmp_path / "a.gltf")


def test_a_linked_buffer_is_not_followed_to_another_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(40))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.bin").symlink_to(tmp_path / "secret.bin")
    path = tmp_path / "in" / "a.gltf"
    buffers = [{"uri": "a.bin", "byteLength": 40}]
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": buffers}))
    with pytest.raises(FileFormatError, match="link to another folder"):
        Document.read(path)


def test_no_nan_is_written_into_gltf(tmp_path: Path) -> None:
    motion = Motion(walker(3).joints().astype("f4"), metadata={"score": float("nan")})
    with pytest.raises(InputError, match="finite"):
        motion.save(tmp_path / "a.glb")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("joints", [300, 20_000])
def test_bvh_of_too_many_joints_of_one_name(joints: int, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="joints"):
        read_bvh(damaged.bvh(tmp_path / "a.bvh", joints))


@pytest.mark.parametrize("time", ["1e-320", "1e300", "0", "nan"])
def test_frame_times(time: str, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"a\.bvh:\d+: "):
        read_bvh(damaged.bvh(tmp_path / "a.bvh", frame_time=time))


@pytest.mark.parametrize("change", [{"unit": "1e-320"}, {"unit": "1e300"}, {"bones": 20_000}])
def test_asf(change: dict, tmp_path: Path) -> None:
    assert len(read_asf_amc(damaged.asf(tmp_path / "a.asf").with_suffix(".amc"))) == 2
    with pytest.raises(FileFormatError, match=r"a\.asf:\d+: "):
        read_asf_amc(damaged.asf(tmp_path / "a.asf", **change).with_suffix(".amc"))


@pytest.mark.parametrize("cell", ["x" * (csv.field_size_limit() + 1), '"', "1e300"])
def test_csv_cells(cell: str, tmp_path: Path) -> None:
    Motion(walker(3).joints().astype("f4")).save(tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    lines[1] = cell + lines[1][8:]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    with pytest.raises(FileFormatError, match=r"a\.csv"):
        formats.load(tmp_path / "a.csv")


@pytest.mark.parametrize("name", ["a\0.npz", f"{'a' * 300}.npz"])
def test_names_that_no_system_takes(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"):
        Motion(walker(3).joints().astype("f4")).save(tmp_path / name)


def test_an_ending_in_capitals_leaves_nothing_else(tmp_path: Path) -> None:
    Motion(walker(3).joints().astype("f4")).save(tmp_path / "o.NPZ")
    assert [path.name for path in tmp_path.iterdir()] == ["o.NPZ"]


def test_a_rate_that_makes_too_many_frames_is_refused() -> None:
    motion = Motion(np.repeat(walker(3).joints(), 10, axis=0).astype("f4"), fps=0.01)
    with warnings.catch_warnings(), pytest.raises(LatentMotionError, match="frames from 30"):
        warnings.simplefilter("ignore")
        motion.resampled(1000)
