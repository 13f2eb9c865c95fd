"""Worker program: cleans up motions and writes files, and reads what others uploaded.

A line of JSON has a list of tasks, and the `size` bytes of each follow it; the answer has the same
form. Memory, the size of files and the time of a task are bounded, so that a file can end no more
than this process.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache, partial
from itertools import compress, islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from latentmotion import formats
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.errors import LatentMotionError
from latentmotion.formats.content import encoded, packed
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.language.claims import Corrections
from latentmotion.motion import Motion, animations
from latentmotion.retarget import read_rig, transfer
from latentmotion.retarget.rig import inspect_rig
from latentmotion.storage import children, configuration
from latentmotion.storage.files import is_disk_full, write_file

MEMORY = 1 << 32  # Largest address space of a worker, bytes (4 GiB).

LARGEST_FILE = 1 << 30  # Largest file that a worker may write, bytes (1 GiB).

Reply = tuple[dict[str, Any], bytes]  # A task or its answer, and the bytes that belong to it.

# Formats that store rotations, which inverse kinematics must find first.
_WITH_ROTATIONS = frozenset({"bvh", "glb", "vrma", "fbx", "usda", "usdc", "usdz"})


def main() -> None:
    """Answers until the input ends."""
    children.limit("AS", MEMORY)
    children.limit("FSIZE", LARGEST_FILE)
    warnings.simplefilter("ignore")
    source, target = sys.stdin.buffer, sys.stdout.buffer
    with suppress(BrokenPipeError):  # the service has ended
        while line := source.readline():
            send(target, answers([(task, source.read(task["size"])) for task in json.loads(line)]))


def send(target: BinaryIO, replies: Sequence[Reply]) -> None:
    """Writes a message."""
    heads = [{**head, "size": len(content)} for head, content in replies]
    target.write(json.dumps(heads).encode() + b"\n")
    target.writelines(content for _, content in replies)
    target.flush()


def answers(tasks: Sequence[Reply]) -> list[Reply]:
    """Does tasks; if there are several they write files, whose motions are prepared together."""
    if len(tasks) == 1:
        return [answer(*tasks[0])]
    try:
        prepared = _prepared(tasks)
    except Exception:  # one of them is at fault, and the others do not pay for it
        return [answer(*task) for task in tasks]
    return [
        _reply_of(partial(_encoded, task, motions))
        for (task, _), motions in zip(tasks, prepared, strict=True)
    ]


def answer(task: dict[str, Any], content: bytes) -> Reply:
    """Runs a task; errors become part of the answer."""
    return _reply_of(lambda: _VERBS[task["verb"]](task, content))


def _reply_of(work: Callable[[], Reply]) -> Reply:
    try:
        return work()
    except LatentMotionError as error:
        return {"full" if is_disk_full(error) else "error": str(error)}, b""
    except MemoryError:
        return {"error": f"the file needs more than {MEMORY >> 30} GB of memory; cut it"}, b""
    except Exception as error:
        if is_disk_full(error):
            return {"full": str(error)}, b""
        return {"failure": f"{type(error).__name__}: {error}"}, b""


def write(task: dict[str, Any], content: bytes) -> Reply:
    """Cleans up motions whose joints are given, and encodes them."""
    return _encoded(task, _prepared([(task, content)])[0])


def _prepared(tasks: Sequence[Reply]) -> list[list[Motion]]:
    """Returns the motions of each task, cleaned up where it says so, all tasks' together."""
    groups: list[list[Motion]] = []
    dirty, corrections = [task["clean"] for task, _ in tasks], []
    for task, content in tasks:
        motions, at = [], 0
        for stored in task["motions"]:
            skeleton = _skeleton(stored["skeleton"])
            shape = stored["frames"], len(skeleton), 3
            joints = np.frombuffer(content, "<f4", int(np.prod(shape)), at).reshape(shape)
            at += joints.nbytes
            motions.append(
                Motion(joints, stored["fps"], skeleton, stored["caption"], stored["metadata"])
            )
            if task["clean"]:
                corrections.append(configuration.from_json(Corrections, stored["corrections"]))
        groups.append(motions)
    together = [motion for motions in compress(groups, dirty) for motion in motions]
    clean = iter(clean_batch(together, CleanUp(), corrections))
    groups = [
        list(islice(clean, len(motions))) if is_dirty else motions
        for motions, is_dirty in zip(groups, dirty, strict=True)
    ]
    turned = [task["fps"] is not None or task["format"] in _WITH_ROTATIONS for task, _ in tasks]
    animations([motion for motions in compress(groups, turned) for motion in motions])
    return groups


def _encoded(task: dict[str, Any], motions: Sequence[Motion]) -> Reply:
    if task["fps"] is not None:
        motions = [motion.resampled(task["fps"]) for motion in motions]
    file, form = encoded(motions, task["format"])
    return {"format": form}, file


@lru_cache(maxsize=16)
def _skeleton(text: str) -> Skeleton:
    """Returns a skeleton from its JSON; the same for the same, so that motions can be alike."""
    values = json.loads(text)
    offsets = np.array(values.pop("offsets"))
    rest: dict[str, Any] = {
        n: tuple(it) if isinstance(it, list) else it for n, it in values.items()
    }
    return Skeleton(offsets=offsets, **rest)


def convert(task: dict[str, Any], content: bytes) -> Reply:
    """Reads the uploaded file, cleans it up if asked to, and writes it in another format."""
    os.chdir(task["folder"])
    motions = formats.load(task["file"])
    if task["clean"] is not None:
        motions = clean_batch(motions, CleanUp(**task["clean"]))
    head, file = _encoded(task, motions)
    return _leave(file, head["format"])


def retarget(task: dict[str, Any], content: bytes) -> Reply:
    """Puts a motion on a character; `figure`: one without a mesh is given a mannequin's."""
    os.chdir(task["folder"])
    rig = read_rig(task["file"], task.get("map"))
    output = Path("moving") / f"character.{task['format']}"
    output.parent.mkdir()
    motions = formats.load("motion.npz")
    if task.get("figure") and output.suffix not in (*rig.file.endings, ".bvh"):
        figures = []
        for motion in motions:
            moved = transfer.retarget(motion.resampled(task["fps"] or motion.fps), rig)
            joints, about = moved.joints().astype(np.float32), (motion.caption, motion.metadata)
            figures.append(Motion(joints, moved.fps, moved.skeleton, *about))
        return _leave(*encoded(figures, task["format"]))
    transfer.check_output(rig, output)
    files = transfer.write(output, rig, motions, task["fps"])
    return _leave(*packed(files, task["format"]))


def rig(task: dict[str, Any], content: bytes) -> Reply:
    """Returns the bones of a character, and those that correspond to our joints."""
    os.chdir(task["folder"])
    return asdict(inspect_rig(task["file"], task.get("map"))), b""


def join(task: dict[str, Any], content: bytes) -> Reply:
    """Makes the answer of a job from the files that hold its motions."""
    folder = Path(task["folder"])
    motions = [motion for file in task["files"] for motion in formats.load(folder / file)]
    joined, form = encoded(motions, task["format"])
    write_file(folder / f"answer.{form}", joined)
    return {"format": form}, b""


def _leave(content: bytes, form: str) -> Reply:
    """Leaves an answer in the folder, so that it need not be in memory twice."""
    Path("answer").write_bytes(content)
    return {"format": form}, b""


_VERBS: dict[str, Callable[[dict[str, Any], bytes], Reply]] = {
    verb.__name__: verb for verb in (write, convert, retarget, rig, join)
}

if __name__ == "__main__":
    main()
