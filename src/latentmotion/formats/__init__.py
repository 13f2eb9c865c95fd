"""File formats: `save` and `load` choose one by the path's ending and import only that module.

Other packages add endings by entry points of the group `latentmotion.formats`.
"""

from __future__ import annotations

import difflib
import importlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from latentmotion.errors import DataError, InputError, ReadingWarning
from latentmotion.motion import Motion
from latentmotion.plugins import plugin, plugin_names
from latentmotion.storage.files import check_writable
from latentmotion.storage.reading import packaged_toml

if TYPE_CHECKING:
    from latentmotion.formats.takes import SkeletonTake
    from latentmotion.kinematics.standing import Stated

# Programs and data sets whose bones `formats/engines.py` knows.
EngineName = Literal["unreal", "unity", "godot", "mixamo", "lafan", "cmu"]

_FORMATS = packaged_toml(__file__, "formats.toml")


def _functions(verb: str) -> Mapping[str, str]:
    rows = ((name, row[verb]) for name, row in _FORMATS.items() if verb in row)
    return {f".{name}": f"latentmotion.{function}" for name, function in rows}


# Each ending of ours that can be written, and that can be read, with its `module:function`.
ENDINGS, READABLE = _functions("write"), _functions("read")

# Each format of ours that services answer with, and its media type.
MEDIA_TYPES = {name: row["media"] for name, row in _FORMATS.items() if "media" in row}


_MARKERS = (
    "C3D holds markers on the skin, not joints: solve a skeleton in your system's program (Vicon "
    "Nexus or Shogun, OptiTrack Motive, Qualisys) or in MotionBuilder, and export BVH or FBX"
)


# Parts of a name before the ending that belong to the ending.
_LAYOUTS = (".amass", ".smplx", ".smpl", ".contacts")


def numbered(path: Path, count: int) -> list[Path]:
    """Returns the names of `count` files: the path itself, or `-1`, `-2` before its ending."""
    if count == 1:
        return [path]
    stem, layout = path.stem, Path(path.stem).suffix
    if layout.lower() in _LAYOUTS:
        stem = path.stem.removesuffix(layout)
    ending = path.name.removeprefix(stem)
    return [path.with_name(f"{stem}-{number}{ending}") for number in range(1, count + 1)]


def readable() -> tuple[str, ...]:
    """Returns every ending that can be read, those of plugins included."""
    return (*READABLE, *(f".{name}" for name in plugin_names("latentmotion.formats")))


def save(path: str | Path, motions: Sequence[Motion], fps: float | None = None) -> list[Path]:
    """Writes motions as the takes of one file, or one file each where a format holds a single take.

    Args:
        path: The file; its ending chooses the format. BVH holds one take, so several motions
            become `out-1.bvh`, `out-2.bvh` and so on.
        motions: The takes, at least one.
        fps: Frames per second to resample to; by default each motion keeps its own.

    Returns:
        The files written.

    Raises:
        InputError: No motions, an unknown ending, an invalid frame rate, text that is none, or a
            folder that cannot be written.
        MissingExtraError: The format needs a package that is not installed.
        MissingProgramError: The format needs Blender, and there is none.
    """
    target = Path(path)
    if not motions:
        raise InputError(f"no motion to write to {target}, expected at least one")
    writer = _function(target, ENDINGS, "write")
    check_writable(target)
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; name a file in it")
    check_text(motions, target)
    takes = motions if fps is None else [motion.resampled(fps) for motion in motions]
    return writer(target, takes) or [target]


def check_text(motions: Sequence[Motion], target: Path) -> None:
    """Checks what motions say of themselves.

    Args:
        motions: What is to be written.
        target: Where.

    Raises:
        InputError: There is text that is none.
    """
    for motion in motions:
        metadata = json.dumps(dict(motion.metadata), ensure_ascii=False, default=str)
        for text in (motion.caption, *motion.skeleton.names, metadata):
            if "\0" in text:
                raise InputError(
                    f"cannot write {target}: the text {ascii(text)[:100]} holds the character NUL, "
                    "which files lose; take it out"
                )
            try:
                text.encode()
            except UnicodeEncodeError as error:
                raise InputError(
                    f"cannot write {target}: the text {ascii(text)[:100]} holds what is no "
                    f"character (at {error.start}); was it read in another encoding than UTF-8?"
                ) from error


def load(path: str | Path, stated: Stated | None = None) -> list[Motion]:
    """Reads all motions of a file, in meters, y up.

    This is the one place where files become motions: unit, up axis, names and rate are what is
    stated, else what the file says, else what the body shows, which is told as a guess.

    Args:
        path: The file.
        stated: What the user says about it.

    Raises:
        DataError: The names of its joints are unknown, or its size or pose is nobody's.
        FileFormatError: The file is damaged or not of its kind.
        InputError: The ending cannot be read, or there is no such file.

    Warns:
        ReadingWarning: Something is a guess, or a small mistake was passed over.
    """
    from latentmotion.formats.takes import standing_motion

    source = Path(path)
    notices: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as notices:
            warnings.simplefilter("always", ReadingWarning)
            trusted = stated is None and source.suffix.lower() != ".npy"  # bare joints say nothing
            return [standing_motion(take, stated, trusted) for take in read(source)]
    except (InputError, DataError) as error:  # of what it holds
        named = str(error).startswith(str(source)) or not source.is_file()
        raise type(error)(str(error) if named else f"{source}: {error}") from error
    finally:
        for text, category in dict.fromkeys(
            (str(notice.message), notice.category) for notice in notices
        ):
            named = category is not ReadingWarning or text.startswith(str(source))
            warnings.warn(text if named else f"{source}: {text}", category, stacklevel=2)


def read(path: str | Path) -> list[SkeletonTake | Motion]:
    """Reads the takes of a file as they are in it.

    Raises:
        FileFormatError: The file is damaged or not of its kind.
        InputError: The ending cannot be read, or there is no such file.
    """
    source = Path(path)
    reader = _function(source, READABLE, "read")
    if not source.is_file():
        raise InputError(f"there is no file {source}")
    return reader(source)


def check_ending(path: str | Path) -> None:
    """Raises what `save` would raise, so that a program can refuse before it generates.

    Raises:
        InputError: The ending is unknown.
        MissingExtraError: The format needs a package that is not installed.
        MissingProgramError: The format needs Blender, and there is none.
    """
    writer = _function(Path(path), ENDINGS, "write")
    check_ready = getattr(importlib.import_module(writer.__module__), "check_ready", None)
    if check_ready is not None:
        check_ready(Path(path).suffix.lower())


def _function(path: Path, endings: Mapping[str, str], verb: str) -> Callable:
    """Imports the reader or writer that an ending names, of this package or of a plugin."""
    ending = path.suffix.lower()
    longer = "".join(path.suffixes[-2:]).lower()
    if longer in endings:
        ending = longer
    elif ending not in endings:
        added = getattr(plugin("latentmotion.formats", ending[1:]), verb, None)
        if added is not None:
            return added
        if ending == ".c3d":
            raise InputError(
                f"{path} cannot be {'written' if verb == 'write' else 'read'}: {_MARKERS}"
            )
        near = difflib.get_close_matches(ending, endings, n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        others = [f".{name}" for name in plugin_names("latentmotion.formats")]
        raise InputError(
            f"{f'the ending {ending!r} of {path}' if ending else f'{path} has no ending: it'} "
            f"cannot be {'written' if verb == 'write' else 'read'}: {hint}"
            f"known are {', '.join([*endings, *others])}"
        )
    module, _, name = endings[ending].partition(":")
    return getattr(importlib.import_module(module), name)
