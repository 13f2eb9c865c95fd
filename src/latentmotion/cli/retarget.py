"""`latentmotion retarget IN.npz --to CHARACTER.glb -o OUT.glb`: motions on the user's character."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.kinematics.animation import check_fps
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.motion import Motion
from latentmotion.retarget import Rig, read_rig
from latentmotion.retarget.draft import draft_map, write_draft
from latentmotion.retarget.rig_files import open_rig
from latentmotion.retarget.transfer import check_output, write
from latentmotion.storage.files import check_writable


@dataclass(frozen=True)
class Retarget:
    """Carry motions to a character of your own: any skeleton in .glb, .gltf, .bvh or .asf.

    Mixamo, Unreal, VRM, Rigify, Daz, CMU, SMPL and Biped names are known; for others draft a map.

    Example: latentmotion retarget walk.npz --to character.glb -o walking.glb
    """

    to: Path
    """The character: .glb, .gltf, .bvh or .asf."""
    files: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILES")] = ()
    """Motion files; each motion in them becomes an animation."""
    output: Annotated[Path | None, arg(aliases=["-o"])] = None
    """File to write: .glb or .gltf is the character with the animations added, .bvh its skeleton
    (one file for each motion)."""
    map: Path | None = None
    """JSON file that says which of the character's joints is which of ours."""
    draft_map: Path | None = None
    """Write a guess of such a file here, and nothing else."""
    fps: float | None = None
    """Frames per second of the animations; by default the motions' own."""

    def run(self) -> None:
        """Reads the character and the motions, writes the character moving.

        Raises:
            LatentMotionError: A file cannot be read or written, or joints are not found.
        """
        if self.draft_map is not None:
            self._draft(self.draft_map)
            return
        if self.output is None or not self.files:
            raise InputError("name motion files and -o FILE, or --draft-map FILE")
        if self.fps is not None:
            check_fps(self.fps)
        check_writable(self.output)
        rig = read_rig(self.to, None if self.map is None else load_joint_map(self.map))
        check_output(rig, self.output)
        motions = [motion for file in self.files for motion in formats.load(file)]
        print("\n".join(_about(rig)))
        written = write(self.output, rig, motions, self.fps, _names(self.files, motions))
        print("\n".join(f"wrote {path}" for path in written))

    def _draft(self, path: Path) -> None:
        check_writable(path)
        skeleton = open_rig(self.to).skeleton
        guesses = draft_map(skeleton)
        write_draft(path, skeleton, guesses)
        for name, guess in guesses.items():
            print(f"{name:<15} {skeleton.names[guess.joint]:<25} {guess.reason}")
        print(f"wrote {path}: these are guesses; correct them, then pass --map {path}")


def _names(files: Sequence[Path], motions: Sequence[Motion]) -> list[str]:
    """Returns what the animations are called: their captions, else their file."""
    stem = files[0].stem
    names = [motion.caption or stem for motion in motions]
    return [n if names.count(n) == 1 else f"{n} {i}" for i, n in enumerate(names, 1)]


def _about(rig: Rig) -> list[str]:
    names, body = rig.skeleton.names, rig.body
    spine = ", ".join(names[joint] for joint in body.spine) or "none"
    resting = len(names) - len({*body.joints.values(), body.pelvis, *body.spine, *body.neck})
    return [
        f"{rig.file.path}: {len(names)} joints, names of {body.names}, in {rig.unit()}, "
        f"legs of {rig.leg:.2f} m",
        f"pelvis {names[body.pelvis]!r}, spine {spine}, "
        f"{resting} joints stay at rest (fingers, twists, tips)",
    ]
