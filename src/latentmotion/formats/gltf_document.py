"""glTF 2.0 on disk: its JSON and its arrays, as `.glb` or as `.gltf` with buffers beside or inside.

    .glb        header (magic "glTF", version 2, length), JSON chunk, BIN chunk
    .gltf       the JSON; buffers and pictures are files beside it or data URIs

A document in memory is self-contained: it has one buffer, which also holds the pictures.
Source: Khronos glTF 2.0 specification, https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import operator
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from latentmotion.errors import FileFormatError, InputError
from latentmotion.storage import files, limits, reading

VERTICES, INDICES = 34962, 34963  # Targets of `add_array` for the arrays of a mesh.

_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {np.dtype(name): number for number, name in _DTYPES.items()}
_SHAPES: dict[str, tuple[int, ...]] = {
    **{"SCALAR": (), "VEC2": (2,), "VEC3": (3,), "VEC4": (4,)},
    **{"MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)},
}
_KINDS = {shape: kind for kind, shape in _SHAPES.items()}
# Beginnings of extensions that say nothing of bones and animations: they are passed through.
_EXTENSIONS = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "KHR_xmp"),
    *("KHR_mesh_quantization", "KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"),
    *("VRM", "VRMC_", "KHR_node_visibility", "MSFT_lod"),
)

_PICTURES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
_DAMAGE = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, struct.error)


class Document:
    """The JSON of a glTF file and its one buffer.

    Args:
        json: Nodes, skins, meshes, animations, accessors and so on, as glTF names them.
        binary: The one buffer.
        path: The file it was read from, for errors.
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
        content = reading.read_bytes(source)
        text, chunk = content, None
        if content[:4] == b"glTF":  # in binary, the JSON and the buffer are chunks
            version, length = struct.unpack("<II", content[4:12].ljust(8, b"\0"))
            if version != 2:
                problem = f"glTF of version {version}, expected 2; convert it first"
                raise FileFormatError(source, problem)
            if len(content) < length or length < 20:
                problem = f"found {len(content)} of {length} bytes: it is truncated"
                raise FileFormatError(source, problem)
            chunks, at = {}, 12
            while at + 8 <= length:
                size, kind = struct.unpack("<I4s", content[at : at + 8])
                chunks.setdefault(kind, content[at + 8 : at + 8 + size])
                at += 8 + size
            text, chunk = chunks.get(b"JSON", b""), chunks.get(b"BIN\0")
        parsed = reading.parse_json(text, source)
        asset = parsed.get("asset") if isinstance(parsed, dict) else None
        version = str(asset.get("version") if isinstance(asset, dict) else None)
        if not version.startswith("2."):
            raise FileFormatError(source, f"found glTF of version {version:.20}, expected 2.0")
        document = cls(parsed, b"", source)
        required = parsed.get("extensionsRequired", [])
        for name in required if isinstance(required, list) else []:
            if not any(str(name).startswith(extension) for extension in _EXTENSIONS):
                raise FileFormatError(
                    source,
                    f"requires the glTF extension {name!s:.60}, which cannot be read; export it "
                    "without, or import it into Blender and export it again",
                )
        try:
            document._collect(chunk)
        except _DAMAGE as error:
            raise FileFormatError(source, f"damaged glTF: {_reason(error)}") from error
        return document

    def write(self, path: str | Path) -> None:
        """Writes `.gltf` where the path ends so, with the buffer inside, else `.glb`.

        Raises:
            InputError: The folder does not exist or cannot be written, or there is a number that is
                not finite.
        """
        files.write_file(path, self.encoded(path))

    def encoded(self, path: str | Path) -> bytes:
        """Returns the content of the file that `write` would write.

        Raises:
            InputError: There is a number that is not finite.
        """
        entries = {key: value for key, value in self.json.items() if key != "buffers"}
        buffer: dict[str, Any] = {"byteLength": len(self.binary)}
        as_text = Path(path).suffix.lower() == ".gltf"
        style: dict[str, Any] = {"indent": 1} if as_text else {"separators": (",", ":")}
        if as_text:
            data = base64.b64encode(self.binary).decode()
            buffer["uri"] = "data:application/octet-stream;base64," + data
        whole = entries | ({"buffers": [buffer]} if self.binary else {})
        try:
            text = json.dumps(whole, allow_nan=False, **style).encode()
        except ValueError as error:
            raise InputError(f"cannot write {path}: {error}; glTF has finite numbers") from error
        if as_text:
            return text
        chunks = [(b"JSON", text + b" " * (-len(text) % 4))]
        if self.binary:
            chunks += [(b"BIN\0", bytes(self.binary) + bytes(-len(self.binary) % 4))]
        body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def array(self, accessor: int) -> np.ndarray:
        """Returns the values of an accessor: (count, ...), matrices in rows; fractions as floats.

        Raises:
            FileFormatError: It reaches past the end of the buffer, or its type is unknown.
        """
        try:
            entry = self.entry("accessors", accessor)
            shape = (operator.index(entry["count"]), *_SHAPES[entry["type"]])
            dtype = np.dtype(_DTYPES[entry["componentType"]])
            most = max(limits.UNPACKED_FREE, limits.UNPACKED_FACTOR * len(self.binary))
            if "bufferView" in entry:
                values = self._values(entry, shape, dtype)
            elif 0 <= math.prod(shape) * dtype.itemsize <= most:
                values = np.zeros(shape, dtype)
            else:
                raise ValueError(f"has {shape[0]:,} zeros, of which the file has none")
            if "sparse" in entry:  # some values are replaced
                count, indices = entry["sparse"]["count"], entry["sparse"]["indices"]
                rows = self._values(indices, (count,), np.dtype(_DTYPES[indices["componentType"]]))
                if count < 0 or (len(rows) and rows.max() >= len(values)):
                    raise ValueError("replaces values that it does not have")
                values[rows] = self._values(entry["sparse"]["values"], (count, *shape[1:]), dtype)
        except _DAMAGE as error:
            problem = f"damaged glTF: accessor {accessor}: {_reason(error)}"
            raise FileFormatError(self.path or "glTF", problem) from error
        if entry.get("normalized") and values.dtype.kind in "iu":
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
            bounds: Whether to store minimum and maximum, as positions and times must.
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

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """Returns an entry of one of the lists.

        Raises:
            TypeError: The index is no whole number, or the entry no object.
            IndexError: There is no such entry.
        """
        entries = self.json[kind]
        if isinstance(index, bool) or not 0 <= operator.index(index) < len(entries):
            raise IndexError(f"there is no {index} among {len(entries)} {kind}")
        if not isinstance(entries[index], dict):
            raise TypeError(f"{kind} {index} is no object")
        return entries[index]

    def _collect(self, chunk: bytes | None) -> None:
        """Gathers all buffers and pictures, inside and beside the file, in the one buffer."""
        starts, linked = [], {}
        for number, buffer in enumerate(self.json.get("buffers", [])):
            inside = number == 0 and "uri" not in buffer
            content = chunk if inside else self._linked(buffer["uri"], linked)
            if content is None or len(content) < buffer["byteLength"]:
                size = 0 if content is None else len(content)
                raise ValueError(f"buffer {number} has {size} of {buffer['byteLength']} bytes")
            self._check_size(linked, chunk)
            self.binary += bytes(-len(self.binary) % 8)
            starts.append(len(self.binary))
            self.binary += content[: buffer["byteLength"]]
        for view in self.json.get("bufferViews", []):
            self.entry("buffers", view["buffer"])
            start = starts[view["buffer"]]
            view["byteOffset"] = operator.index(view.get("byteOffset", 0)) + start
            view["buffer"] = 0
        for picture in self.json.get("images", []):
            uri = picture.get("uri", "data:")
            if not uri.startswith("data:"):
                kind = _PICTURES.get(Path(unquote(uri)).suffix.lower())
                self._check_size(linked, chunk)
                picture["bufferView"] = self.add_view(self._linked(uri, linked))
                picture["mimeType"] = picture.get("mimeType", kind)
                del picture["uri"]

    def _check_size(self, linked: Mapping[str, bytes], chunk: bytes | None) -> None:
        """Checks that files that are named again and again do not add up."""
        read = sum(map(len, linked.values())) + len(chunk or b"")
        if len(self.binary) > max(limits.UNPACKED_FREE, limits.UNPACKED_FACTOR * read):
            raise ValueError("its buffers and pictures name the same files too often")

    def _linked(self, uri: str, contents: dict[str, bytes]) -> bytes:
        """Returns the content of a data URI or of a file beside this one; refuses others."""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        if uri in contents:
            return contents[uri]
        assert self.path is not None
        if len(uri) > limits.MOST_ADDRESS:
            raise ValueError(f"names a file by {len(uri):,} letters ({uri[:40]!r}…)")
        name = Path(unquote(uri))
        if "://" in uri or name.is_absolute() or ".." in name.parts:
            raise ValueError(f"names {uri!r}; expected a file in its own folder")
        beside = self.path.parent / name
        try:
            is_there = beside.is_file()
        except OSError as error:  # a part of the name is too long
            raise ValueError(f"names {uri[:40]!r}…, which cannot be: {error.strerror}") from error
        if beside.exists() and not beside.resolve().is_relative_to(self.path.parent.resolve()):
            raise ValueError(f"names {uri!r}, a link to another folder; copy the file here")
        if not is_there:
            raise ValueError(
                f"it names {beside.name}, which cannot be read: there is no such file; copy it here"
            )
        contents[uri] = reading.read_bytes(beside)
        return contents[uri]

    def _values(
        self, source: dict[str, Any], shape: tuple[int, ...], dtype: np.dtype
    ) -> np.ndarray:
        """Reads from the buffer view and the offset that `source` names."""
        view = self.entry("bufferViews", source["bufferView"])
        offset = operator.index(source.get("byteOffset", 0))
        if "extensions" in view:
            raise ValueError(f"is compressed ({', '.join(view['extensions'])}); save it without")
        size = math.prod(shape[1:]) * dtype.itemsize
        stride = operator.index(view.get("byteStride", size))
        if stride < size:
            raise ValueError(f"has a stride of {stride} bytes, expected {size} or more")
        start = view.get("byteOffset", 0)
        end = start + operator.index(view["byteLength"])
        if min(start, offset, shape[0] - 1) < 0 or end > len(self.binary):
            raise ValueError("reaches past the end of the buffer")
        if offset + stride * (shape[0] - 1) + size > view["byteLength"]:
            raise ValueError("reaches past the end of its buffer view")
        inner = np.zeros(shape[1:], dtype).strides
        rows = np.ndarray(shape, dtype, self.binary, start + offset, (stride, *inner))
        return rows.copy()


def _reason(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"{error} is missing or unknown"
    if isinstance(error, binascii.Error):
        return f"a data URI cannot be read ({error})"
    return str(error)
