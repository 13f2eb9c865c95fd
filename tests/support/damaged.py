"""Damaged and hostile files: bombs, lies about sizes, types of another kind."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def header(shape: tuple[int, ...], dtype: str = "<f4") -> bytes:
    """The head of an `.npy` file that says it has this shape."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        file, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return file.getvalue()


def npz(path: Path, members: Mapping[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> Path:
    """An `.npz` of any bytes."""
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


def arrays(path: Path, **changes: Any) -> Path:
    """A motion of one take whose arrays are exchanged, or left out where they are None."""
    from latentmotion.motion import Motion
    from tests.support.walker import walker

    Motion(walker(3).joints().astype("f4")).save(path)
    with np.load(path) as file:
        content = {name: file[name] for name in file.files} | changes
    np.savez(path, **{name: value for name, value in content.items() if value is not None})
    return path


def bvh(path: Path, joints: int = 2, frame_time: str = "0.05", name: str = "a") -> Path:
    """A chain of joints, all of one name."""
    middle = [f"JOINT {name}", "{", "OFFSET 0 1 0", "CHANNELS 0"] * (joints - 1)
    root = ["HIERARCHY", "ROOT root", "{", "OFFSET 0 0 0", "CHANNELS 1 Yrotation"]
    end = ["}"] * joints + ["MOTION", "Frames: 2", f"Frame Time: {frame_time}", "0", "0"]
    path.write_text("\n".join([*root, *middle, *end]) + "\n")
    return path


def asf(path: Path, unit: str = "0.45", bones: int = 2) -> Path:
    """A star of bones."""
    blocks = "".join(
        f"begin\nname b{n}\ndirection 0 1 0\nlength 1\naxis 0 0 0 XYZ\nend\n" for n in range(bones)
    )
    names = " ".join(f"b{n}" for n in range(bones))
    path.write_text(
        f":units\nlength {unit}\nangle deg\n:root\norder TX TY TZ RX RY RZ\n"
        f":bonedata\n{blocks}:hierarchy\nbegin\nroot {names}\nend\n"
    )
    path.with_suffix(".amc").write_text(":degrees\n1\nroot 0 0 0 0 0 0\n2\nroot 0 0 0 0 0 0\n")
    return path


def gltf(path: Path, binary: bytes = b"", **changes: Any) -> Path:
    """A `.glb` of three bones and one animation, with other lists in its JSON."""
    times, turns = np.array([0, 0.05], "<f4"), np.tile(np.array([0, 0, 0, 1], "<f4"), (2, 1))
    buffer = times.tobytes() + turns.tobytes() + binary
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "nodes": [{"name": "a", "children": [1]}, {"name": "b", "children": [2]}, {"name": "c"}],
        "skins": [{"joints": [0, 1, 2]}],
        "buffers": [{"byteLength": len(buffer)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 8},
            {"buffer": 0, "byteOffset": 8, "byteLength": 32},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"},
        ],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
                "samplers": [{"input": 0, "output": 1}],
            }
        ],
    } | changes
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    buffer += bytes(-len(buffer) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return path
