"""`latentmotion retarget IN.npz --to CHARACTER.glb -o OUT.glb`: motions on the user's character."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.errors import InputError
from latentmotion.kinematics.animation import check_fps
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.retarget import draft, read_rig, transfer
from latentmotion.retarget.rig_files import open_rig
from latentmotion.storage.files import check_writable


@dataclass(frozen=True)
class Retarget:
    """Retarget motions to your own character: any skeleton in .glb, .gltf, .bvh or .asf.

    The joint names of Mixamo, Unreal, VRM, Rigify, Daz, CMU, SMPL and Biped are known; draft a
    joint map for others.

    Example: latentmotion retarget walk.npz --to character.glb -o walking.glb
    """

    to: Path
    """The character: .glb, .gltf, .bvh or .asf."""
    files: options.Files = ()
    """Motion files; each motion in them becomes an animation."""
    output: options.OptionalOutput = None
    """File to write: .glb or .gltf for the character with the animations added, .bvh for its
    skeleton (one file per motion)."""
    map: Path | None = None
    """JSON file that maps the character's joints to ours."""
    draft_map: Path | None = None
    """Write a guess of such a file here, and nothing else."""
    fps: float | None = None
    """Frames per second of the animations; by default those of the motions."""

    def run(self) -> None:
        """Reads the character and the motions, writes the character moving.

        Raises:
            LatentMotionError: A file cannot be read or written, or joints are not found.
        """
        if self.draft_map is not None:
            self.write_draft(self.draft_map)
            return
        if self.output is None or not self.files:
            raise InputError("name motion files and -o FILE, or --draft-map FILE")
        if self.fps is not None:
            check_fps(self.fps)
        check_writable(self.output)
        rig = read_rig(self.to, None if self.map is None else load_joint_map(self.map))
        transfer.check_output(rig, self.output)
        motions = [motion for file in self.files for motion in formats.load(file)]
        joints, body = rig.skeleton.names, rig.body
        spine = ", ".join(joints[joint] for joint in body.spine) or "none"
        moved = {*body.joints.values(), body.pelvis, *body.spine, *body.neck}
        print(
            f"{rig.file.path}: {len(joints)} joints, names of {body.names}, in {rig.unit()}, "
            f"legs of {rig.leg:.2f} m\n"
            f"pelvis {joints[body.pelvis]!r}, spine {spine}, "
            f"{len(joints) - len(moved)} joints stay at rest (fingers, twists, tips)"
        )
        # Animations are named by their captions, else by the first file.
        names = [motion.caption or self.files[0].stem for motion in motions]
        names = [n if names.count(n) == 1 else f"{n} {i}" for i, n in enumerate(names, 1)]
        written = transfer.write(self.output, rig, motions, self.fps, names)
        print("\n".join(f"wrote {path}" for path in written))

    def write_draft(self, path: Path) -> None:
        """Writes guesses of the joint map to a file and prints them."""
        check_writable(path)
        skeleton = open_rig(self.to).skeleton
        guesses = draft.draft_map(skeleton)
        draft.write_draft(path, skeleton, guesses)
        for name, guess in guesses.items():
            print(f"{name:<15} {skeleton.names[guess.joint]:<25} {guess.reason}")
        print(f"wrote {path}: these are guesses; correct them, then pass --map {path}")
