"""`latentmotion clean`, `retarget`, `blender-addon`: motions of files and on characters."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from latentmotion import formats, robots
from latentmotion.blender import build_zip, own_command
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.cleanup.pipeline import Changes, CleanUpWarning, floor_under
from latentmotion.cli import options
from latentmotion.errors import InputError, ReadingWarning
from latentmotion.kinematics import draft
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.plausibility import foot_sliding
from latentmotion.kinematics.skeleton import Animation, Skeleton, check_fps
from latentmotion.motion import Motion
from latentmotion.retarget import Rig, read_rig, transfer
from latentmotion.retarget.rig_files import open_rig
from latentmotion.storage.files import check_writable


@dataclass(frozen=True)
class Clean(options.MotionOptions):
    """Clean up a motion: hold standing feet, remove jitter, put the figure on the floor.

    A BVH file that is cleaned into a BVH file keeps its skeleton, its unit and its axes.

    Example: latentmotion clean walk.npz -o walk.bvh --no-smooth
    """

    file: Annotated[options.File, arg(help=options.MOTION_FILE)]
    output: options.Outputs
    """Files to write; the extension selects the format."""
    skeleton: Literal["own", "ours"] = "own"
    """Skeleton of a BVH file that is written: the file's own with all its joints, or our 22."""
    smooth: bool = True
    """Remove jitter."""
    bones: bool = True
    """Keep the length of every bone constant."""
    floor: bool = True
    """Put the figure on the floor."""
    feet: bool = True
    """Hold feet in place while they stand."""
    in_place: bool = False
    """Remove the root's path along the floor, as game engines expect."""
    cutoff: float = 5.0
    """Cutoff frequency of the smoothing in hertz: faster movement counts as jitter."""

    def run(self) -> None:
        """Reads, cleans, writes.

        Raises:
            InputError: The file cannot be read, or an ending or a folder cannot be used.
        """
        if not self.smooth:
            options.refuse_unused(self, "--no-smooth leaves jitter as it is", "cutoff")
        steps = CleanUp(**options.values_for(CleanUp, self))
        options.check_outputs(self.output)
        before = self.load(self.file)
        motions = clean_batch(before, steps)
        written: list[Path] = []
        for path in self.output:
            if self.skeleton == "ours":
                written += formats.save(path, [motion.with_recorded(None) for motion in motions])
            elif {path.suffix.lower(), self.file.suffix.lower()} == {".bvh"}:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", ReadingWarning)  # told when it was read
                    rig = read_rig(self.file, stated=self.stated())
                written += transfer.write(path, replace(rig, floor=0.0), motions)
            else:
                written += formats.save(path, motions)
        options.print_written(written)
        for old, new in zip(before, motions, strict=True):
            print_changes(Changes.of(old, new), in_place=self.in_place)


def print_changes(changes: Changes, in_place: bool = False) -> None:
    """Prints what a clean-up did; a warning where that is much."""
    print(changes.text)
    if changes.problem and not in_place:
        warnings.warn(changes.problem, CleanUpWarning, stacklevel=2)


@dataclass(frozen=True)
class RetargetMotions(options.MotionOptions):
    """Retarget motions to your own character: any skeleton in .glb, .gltf, .vrm, .fbx, .bvh.

    The joint names of Mixamo, Unreal, Unity, VRM, Rigify, Daz, Character Creator, Biped, Xsens,
    OptiTrack, Rokoko, ARKit, CMU and SMPL are known; draft a joint map for others. FBX goes
    through your Blender. Robots: MuJoCo's .xml or .urdf, to .csv or .npz of their hinges' angles.

    Example: latentmotion retarget walk.npz --to character.glb -o walking.glb
    """

    to: Path
    """The character: .glb, .gltf, .vrm, .fbx or .bvh; or a robot: .xml or .urdf."""
    files: options.Files = ()
    """Motion files; each motion in them becomes an animation."""
    output: options.OptionalOutput = None
    """File to write: .glb, .gltf or .fbx for the character with the animations added, .bvh for its
    skeleton (one file per motion); .csv or .npz for a robot."""
    draft_map: options.DraftMapFile = None
    root_motion: transfer.RootMotion = "pelvis"
    """What the path along the floor moves: the pelvis, the root bone of a rig that has one above
    the pelvis, as Unreal expects, or nothing (in place)."""
    output_fps: float | None = None
    """Frames per second of the animations; by default those of the motions."""

    def run(self) -> None:
        """Reads the character and the motions, writes the character moving.

        Raises:
            LatentMotionError: A file cannot be read or written, or joints are not found.
        """
        if self.draft_map is not None:
            write_draft(self.draft_map, open_rig(self.to).skeleton)
            return
        if self.output is None or not self.files:
            raise InputError("name motion files and -o FILE, or --draft-map FILE")
        if self.output_fps is not None:
            check_fps(self.output_fps)
        check_writable(self.output)
        if self.to.suffix.lower() in (".xml", ".urdf"):
            robot = robots.read_robot(self.to)
            robots.check_output(self.output)
            print(f"{self.to}: {len(robot.hinges)} hinges: {', '.join(robot.hinges)}")
            motions = [motion for file in self.files for motion in self.load(file)]
            moving = [
                robots.retarget(motion.resampled(self.output_fps or motion.fps), robot)
                for motion in motions
            ]
            for path, clip in zip(robots.write(self.output, moving), moving, strict=True):
                print(
                    f"wrote {path}: {len(clip.angles)} frames at {clip.fps:g} per second, "
                    f"{clip.violations} angles beyond their limits, "
                    f"ankles {100 * clip.missed:.1f} cm off, fastest hinge {clip.fastest:.1f} rad/s"
                )
            return
        rig = read_rig(self.to, stated=self.stated())
        transfer.check_output(rig, self.output)
        if self.root_motion == "root":
            transfer.check_root_bone(rig)
        motions = [motion for file in self.files for motion in self.load(file)]
        joints, body = rig.skeleton.names, rig.body
        spine = ", ".join(joints[joint] for joint in body.spine) or "none"
        print(
            f"{rig.file.path}: {len(joints)} joints, names of {body.names}, in {rig.unit()}, "
            f"legs of {rig.leg:.2f} m, pelvis {joints[body.pelvis]!r}, spine {spine}"
        )
        # Animations are named by their captions, else by the first file.
        names = [motion.caption or self.files[0].stem for motion in motions]
        names = [n if names.count(n) == 1 else f"{n} {i}" for i, n in enumerate(names, 1)]
        moving = transfer.retargeted(rig, motions, self.output_fps, self.root_motion)
        options.print_written(transfer.write_animations(self.output, rig, moving, names))
        for motion, animation in zip(motions, moving, strict=True):
            print(_figures(rig, motion, animation))


def _figures(rig: Rig, motion: Motion, animation: Animation) -> str:
    """Returns how a motion is on a character, in one line."""
    joints, at = animation.joints(), rig.body.joints
    left, right = (
        tuple(at[name] for name in (f"{side}_ankle", f"{side}_foot") if name in at)
        for side in SIDES
    )
    feet = replace(rig.skeleton, left_foot=left, right_foot=right)
    slid = foot_sliding(motion.joints, motion.fps, motion.skeleton, floor_under(motion.joints))
    slides = foot_sliding(joints, animation.fps, feet, floor_under(joints))
    turned = np.abs(animation.rotations - animation.rotations[:1]).max(axis=(0, 2, 3)) > 1e-4
    lowest = joints[:, list(at.values()), 1].min()  # not of controls and roots
    return (
        f"{int(turned.sum())} bones turn; lowest joint {100 * lowest:.1f} cm above "
        f"the floor; feet slide {100 * slid:.1f} → {100 * slides:.1f} cm/s"
    )


def write_draft(path: Path, skeleton: Skeleton) -> None:
    """Writes guesses of a joint map to a file and prints them.

    Raises:
        DataError: Nothing can be guessed.
        InputError: The file cannot be written.
    """
    check_writable(path)
    guesses = draft.draft_map(skeleton)
    draft.write_draft(path, skeleton, guesses)
    for name, guess in guesses.items():
        print(f"{name:<15} {skeleton.names[guess.joint]:<25} {guess.reason}")
    print(f"wrote {path}: these are guesses; correct them, then pass --map {path}")


@dataclass(frozen=True)
class BlenderAddon:
    """Write the add-on for Blender 4.2 and later.

    Then, in Blender: Edit > Preferences > Add-ons > Install from Disk, and choose the zip.
    """

    output: options.Output = Path("latentmotion-blender.zip")
    """Zip file to write."""
    remember: bool = True
    """Store the path of this command in the zip, so that the add-on finds it; turn it off for a
    zip that you pass on."""

    def run(self) -> None:
        """Writes the zip.

        Raises:
            InputError: The ending is not .zip, or the folder cannot be written.
        """
        if self.output.suffix.lower() != ".zip":
            raise InputError(f"cannot write {self.output}: Blender installs .zip files alone")
        build_zip(self.output, own_command() if self.remember else None)
        print(f"wrote {self.output}")
        print("in Blender: Edit > Preferences > Add-ons > Install from Disk, choose this file")
