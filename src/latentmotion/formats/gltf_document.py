"""glTF 2.0 on disk: its JSON and its arrays, as `.glb` or as `.gltf` with buffers beside or inside.

    .glb        header (magic "glTF", version 2, length), JSON chunk, BIN chunk
    .gltf       the JSON; buffers and pictures are files beside it or data URIs

A document in memory holds everything itself: all buffers are one, pictures lie in it too.
Source: Khronos glTF 2.0 specification, https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from latentmotion.errors import FileFormatError
from latentmotion.storage.files import atomic_file

VERTICES, INDICES = 34962, 34963
"""Targets of `add_array` for the arrays of a mesh."""

_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {np.dtype(name): number for number, name in _DTYPES.items()}
_SHAPES: dict[str, tuple[int, ...]] = {
    **{"SCALAR": (), "VEC2": (2,), "VEC3": (3,), "VEC4": (4,)},
    **{"MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)},
}
_KINDS = {shape: kind for kind, shape in _SHAPES.items()}
_PICTURES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
_DAMAGE = (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error)


class Document:
    """The JSON of a glTF file and the bytes that its buffer views lie in.

    Args:
        json: Nodes, skins, meshes, animations, accessors and so on, as glTF names them.
        binary: The one buffer.
        path: Where it was read, for errors.
    """

    def __init__(
        self, json: dict[str, Any] | None = None, binary: bytes = b"", path: Path | None = None
    ) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}} if json is None else json
        self.binary = bytearray(binary)
        self.path = path

    @classmethod
    def read(cls, path: str | Path) -> Document:
        """Reads a `.glb` or `.gltf` file; which one it is shows in its first bytes.

        Raises:
            FileFormatError: The file, or one that it names, is damaged, missing or not glTF 2.0.
        """
        source = Path(path)
        content = _content(source, source)
        text, chunk = _chunks(source, content) if content[:4] == b"glTF" else (content, None)
        document = cls(_parsed(source, text), b"", source)
        try:
            document._collect_buffers(chunk)
            document._collect_pictures()
        except _DAMAGE as error:
            raise FileFormatError(source, f"damaged glTF: {_said(error)}") from error
        return document

    def write(self, path: str | Path) -> None:
        """Writes `.gltf` where the path ends so, with the buffer inside, else `.glb`.

        Raises:
            InputError: The folder does not exist or cannot be written.
        """
        if Path(path).suffix.lower() == ".gltf":
            buffer = base64.b64encode(self.binary).decode()
            whole = self._whole(uri="data:application/octet-stream;base64," + buffer)
            content = json.dumps(whole, indent=1, allow_nan=False).encode()
        else:
            content = self._glb()
        with atomic_file(path) as temporary:
            temporary.write_bytes(content)

    def array(self, accessor: int) -> np.ndarray:
        """Returns the values of an accessor: (count, ...), matrices in rows; fractions as floats.

        Raises:
            FileFormatError: It reaches past the end of the buffer, or is of no known kind.
        """
        try:
            about = self.json["accessors"][accessor]
            shape = (about["count"], *_SHAPES[about["type"]])
            dtype = np.dtype(_DTYPES[about["componentType"]])
            values = np.zeros(shape, dtype)
            if "bufferView" in about:
                offset = about.get("byteOffset", 0)
                values = self._values(about["bufferView"], offset, shape, dtype)
            if "sparse" in about:
                values = self._replaced(values, about["sparse"])
        except _DAMAGE as error:
            problem = f"damaged glTF: accessor {accessor}: {_said(error)}"
            raise FileFormatError(self.path or "glTF", problem) from error
        if about.get("normalized") and values.dtype.kind in "iu":
            values = np.maximum(values / np.float32(np.iinfo(values.dtype).max), -1)
        return np.swapaxes(values, 1, 2) if values.ndim == 3 else values

    def add_array(
        self, array: np.ndarray, target: int | None = None, *, bounds: bool = False
    ) -> int:
        """Appends an array and returns the index of its accessor.

        Args:
            array: (count,), (count, 2 to 4) or matrices in rows; of 32-bit floats or integers
                that glTF knows.
            target: `VERTICES` or `INDICES` where it belongs to a mesh.
            bounds: Whether to say its least and greatest, as positions and times must.
        """
        values = np.swapaxes(array, 1, 2) if array.ndim == 3 else array
        data = np.ascontiguousarray(values)
        accessor: dict[str, Any] = {
            "bufferView": self.add_view(data.tobytes(), target),
            "componentType": _COMPONENTS[data.dtype],
            "count": len(data),
            "type": _KINDS[data.shape[1:]],
        }
        if bounds:
            columns = data.reshape(len(data), -1)
            accessor |= {"min": columns.min(0).tolist(), "max": columns.max(0).tolist()}
        return self.add("accessors", accessor)

    def add_view(self, content: bytes, target: int | None = None) -> int:
        """Appends bytes and returns the index of their buffer view."""
        self.binary += bytes(-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.binary += content
        return self.add("bufferViews", view | ({"target": target} if target else {}))

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Appends to one of the lists, e.g. `nodes`, and returns the index."""
        entries = self.json.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def _collect_buffers(self, chunk: bytes | None) -> None:
        starts = []
        for number, buffer in enumerate(self.json.get("buffers", [])):
            content = chunk if number == 0 and "uri" not in buffer else self._named(buffer["uri"])
            if content is None or len(content) < buffer["byteLength"]:
                found = 0 if content is None else len(content)
                raise ValueError(f"buffer {number} has {found} of {buffer['byteLength']} bytes")
            self.binary += bytes(-len(self.binary) % 8)
            starts.append(len(self.binary))
            self.binary += content[: buffer["byteLength"]]
        for view in self.json.get("bufferViews", []):
            view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
            view["buffer"] = 0

    def _collect_pictures(self) -> None:
        for picture in self.json.get("images", []):
            uri = picture.get("uri", "data:")
            if not uri.startswith("data:"):
                kind = _PICTURES.get(Path(unquote(uri)).suffix.lower())
                picture["bufferView"] = self.add_view(self._named(uri))
                picture["mimeType"] = picture.get("mimeType", kind)
                del picture["uri"]

    def _named(self, uri: str) -> bytes:
        """Returns what a data URI holds, or the file beside this one; never one elsewhere."""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        assert self.path is not None
        name = Path(unquote(uri))
        if "://" in uri or name.is_absolute() or ".." in name.parts:
            raise ValueError(f"names {uri!r}; expected a file in its own folder")
        return _content(self.path, self.path.parent / name)

    def _values(
        self, number: int, offset: int, shape: tuple[int, ...], dtype: np.dtype
    ) -> np.ndarray:
        view = self.json["bufferViews"][number]
        if "extensions" in view:
            raise ValueError(f"is compressed ({', '.join(view['extensions'])}); save it without")
        size = math.prod(shape[1:]) * dtype.itemsize
        stride = view.get("byteStride", size)
        start = view.get("byteOffset", 0)
        end = start + view["byteLength"]
        if min(start, offset, shape[0] - 1) < 0 or end > len(self.binary):
            raise ValueError("reaches past the end of the buffer")
        if offset + stride * (shape[0] - 1) + size > view["byteLength"]:
            raise ValueError("reaches past the end of its buffer view")
        at = start + offset + stride * np.arange(shape[0])[:, None] + np.arange(size)
        return np.frombuffer(self.binary, np.uint8)[at].view(dtype).reshape(shape)

    def _replaced(self, values: np.ndarray, sparse: dict[str, Any]) -> np.ndarray:
        index, new, count = sparse["indices"], sparse["values"], sparse["count"]
        dtype = np.dtype(_DTYPES[index["componentType"]])
        places = self._values(index["bufferView"], index.get("byteOffset", 0), (count,), dtype)
        shape = (count, *values.shape[1:])
        values = values.copy()
        values[places] = self._values(
            new["bufferView"], new.get("byteOffset", 0), shape, values.dtype
        )
        return values

    def _glb(self) -> bytes:
        text = json.dumps(self._whole(), separators=(",", ":"), allow_nan=False).encode()
        chunks = _chunk(b"JSON", text + b" " * (-len(text) % 4))
        if self.binary:
            chunks += _chunk(b"BIN\0", bytes(self.binary) + bytes(-len(self.binary) % 4))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _whole(self, **where: str) -> dict[str, Any]:
        """Returns the JSON with the buffer as it is now."""
        rest = {key: value for key, value in self.json.items() if key != "buffers"}
        buffer = {"byteLength": len(self.binary), **where}
        return rest | ({"buffers": [buffer]} if self.binary else {})


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<I4s", len(content), kind) + content


def _chunks(path: Path, content: bytes) -> tuple[bytes, bytes | None]:
    """Returns the JSON of a `.glb` and its buffer, if it has one."""
    version, length = struct.unpack("<II", content[4:12].ljust(8, b"\0"))
    if version != 2:
        raise FileFormatError(path, f"glTF of version {version}, expected 2; convert it first")
    if len(content) < length or length < 20:
        raise FileFormatError(path, f"found {len(content)} of {length} bytes: it is truncated")
    parts, at = {}, 12
    while at + 8 <= length:
        size, kind = struct.unpack("<I4s", content[at : at + 8])
        parts.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    return parts.get(b"JSON", b""), parts.get(b"BIN\0")


def _parsed(path: Path, text: bytes) -> dict[str, Any]:
    try:
        parsed = json.loads(text)
    except ValueError as error:
        raise FileFormatError(path, f"not glTF: its JSON cannot be read ({error})") from error
    version = parsed.get("asset", {}).get("version") if isinstance(parsed, dict) else None
    if not str(version).startswith("2."):
        raise FileFormatError(path, f"found glTF of version {version}, expected 2.0")
    return parsed


def _content(document: Path, path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        named = "" if path == document else f"it names {path.name}, which "
        problem = f"{named}cannot be read: {error.strerror or error}"
        raise FileFormatError(document, problem) from error


def _said(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"{error} is missing or unknown"
    if isinstance(error, binascii.Error):
        return f"a data URI cannot be read ({error})"
    return str(error)
