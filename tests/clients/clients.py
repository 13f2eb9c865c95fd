"""The clients themselves: each opens a file and says where its bones are, take by take."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.motion import Motion

HERE = Path(__file__).parent
# From our axes to those of a world whose up axis this is, as glTF and USD define the turn.
UP = {"z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), "y": np.eye(3, dtype=int)}


@dataclass(frozen=True, eq=False)
class Seen:
    """One take as a client shows it, in the client's own axes and units."""

    bones: list[str]
    positions: Float[np.ndarray, "frames bones 3"]
    seconds: float
    soles: list[float]

    def joints(self, motion: Motion) -> Float[np.ndarray, "frames joints 3"]:
        """The bones that a motion's joints are, by name."""
        return self.positions[:, [self.bones.index(name) for name in motion.skeleton.names]]


@dataclass(frozen=True)
class Measured:
    """How a client's take differs from the motion."""

    error: float  # Largest distance of a bone from its joint in any frame, meters.
    scale: float  # How much larger the figure is than it should be.
    up: str  # The axis of the client along which the figure stands at the start.
    speed: float  # Seconds of the motion over seconds of the clip.
    sole: float | None  # Median height of the skin's lowest point, meters.


def measure(seen: Seen, motion: Motion, up: str, frames: Sequence[int] | None = None) -> Measured:
    """Compares a take with its motion; of some frames only, if the client was asked for some."""
    chosen = np.arange(len(motion)) if frames is None else np.asarray(frames)
    found, meant = seen.joints(motion), motion.joints[chosen].astype(np.float64) @ UP[up].T
    assert found.shape == meant.shape
    head, pelvis = motion.skeleton.names.index("head"), 0
    stands = found[0, head] - found[0, pelvis]
    spread = [np.linalg.norm(p - p.mean(1, keepdims=True), axis=-1).sum() for p in (found, meant)]
    axis = int(np.argmax(np.abs(stands)))
    return Measured(
        error=float(np.linalg.norm(found - meant, axis=-1).max()),
        scale=float(spread[0] / spread[1]),
        up=("+" if stands[axis] > 0 else "-") + "xyz"[axis],
        speed=(len(motion) - 1) / motion.fps / seen.seconds,
        sole=float(np.median(seen.soles)) if seen.soles else None,
    )


def in_blender(python: str, files: Sequence[dict[str, Any]], folder: Path) -> list[dict[str, Any]]:
    """Opens files in Blender; see in_blender.py for what a file is told by."""
    job, result = folder / "job.json", folder / "blender.json"
    job.write_text(json.dumps({"files": list(files), "result": str(result)}))
    run([python, str(HERE / "in_blender.py"), str(job)])
    return json.loads(result.read_text())


def in_usd(python: str, path: Path, folder: Path) -> dict[str, Any]:
    run([python, str(HERE / "in_usd.py"), str(path), str(folder / "usd.json")])
    return json.loads((folder / "usd.json").read_text())


def in_browser(node_modules: Path, job: dict[str, Any], folder: Path) -> dict[str, Any]:
    job |= {"modules": str(node_modules), "page": str(HERE / "three.html")}
    job |= {"result": str(folder / "three.json")}
    (folder / "three_job.json").write_text(json.dumps(job))
    run(["node", str(HERE / "in_browser.cjs"), str(folder / "three_job.json")], node_modules)
    return json.loads((folder / "three.json").read_text())


def validate(node_modules: Path, path: Path) -> dict[str, Any]:
    return json.loads(run(["node", str(HERE / "validate.cjs"), str(path)], node_modules))


def takes(report: dict[str, Any]) -> list[Seen]:
    return [
        Seen(
            bones=take.get("bones") or report["bones"],
            positions=np.array(take["positions"]),
            seconds=take["seconds"],
            soles=take.get("soles", []),
        )
        for take in report["takes"]
    ]


def run(command: list[str], node_modules: Path | None = None) -> str:
    """Runs a program; what it said is in the error if it fails."""
    environment = os.environ | ({"NODE_PATH": str(node_modules)} if node_modules else {})
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-2000:]
    return done.stdout
