"""`latentmotion render|retarget|blender-addon`: motions as pictures, on characters, in Blender."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from latentmotion import formats
from latentmotion.blender.build import build_zip, own_command
from latentmotion.cli import options
from latentmotion.errors import InputError
from latentmotion.kinematics import draft
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.kinematics.skeleton import Skeleton, check_fps
from latentmotion.render import strip, video
from latentmotion.retarget import read_rig, transfer
from latentmotion.retarget.rig_files import open_rig
from latentmotion.storage.files import check_writable

_VIDEOS, _PICTURES = (".mp4", ".gif"), (".png",)

_SMOOTH = 30.0
"""Maximum frames per second of a video by default."""

_INPUT = f"Motion files: {' '.join(formats.READABLE)}. Each motion in them is a take."


@dataclass(frozen=True)
class Render:
    """Draw motions as a video, a GIF or a picture strip.

    Examples:
        latentmotion render walk.npz -o walk.mp4 walk.gif
        latentmotion render walk.npz run.bvh -o strip.png --style path
    """

    files: Annotated[options.Files, arg(help=_INPUT)]
    output: options.Outputs
    """Files to write; the extension selects the format: .mp4 .gif .png. Takes are drawn side by
    side in videos and one below the other in strips."""
    style: strip.Style = "row"
    """Strips: figures in a row, or fading along the path."""
    figures: int = 9
    """Strips: figures per take."""
    camera: video.View = "follow"
    """Videos: the camera follows the person, or stands still and sees the whole path."""
    fps: float | None = None
    """Videos: frames per second; by default those of the first file, at most 30."""
    size: int | None = None
    """Pixels: height of videos (default 512) or width of strips (default 1280)."""

    def run(self) -> None:
        """Reads, draws, writes.

        Raises:
            InputError: A file cannot be read, or an ending, a number or a folder cannot be used.
            FileFormatError: A file is damaged.
            MissingExtraError: Pillow or PyAV is not installed.
        """
        if not self.files:
            raise InputError("no motion file given; try: latentmotion render walk.npz -o walk.mp4")
        if self.fps is not None:
            check_fps(self.fps)
        for path in self.output:
            if path.suffix.lower() not in _VIDEOS + _PICTURES:
                known = " ".join(_VIDEOS + _PICTURES)
                raise InputError(f"cannot draw {path}: its ending is none of {known}")
            if path.is_dir():
                raise InputError(f"cannot write {path}: it is a folder; name a file in it")
            check_writable(path)
        motions = [motion for path in self.files for motion in formats.load(path)]
        for path in self.output:
            if path.suffix.lower() in _PICTURES:
                width = strip.WIDTH if self.size is None else self.size
                strip.write(path, motions, self.style, self.figures, width)
            else:
                fps = min(motions[0].fps, _SMOOTH) if self.fps is None else self.fps
                takes = [motion.resampled(fps) for motion in motions]
                video.write(path, takes, 512 if self.size is None else self.size, self.camera)
            print(f"wrote {path}")


@dataclass(frozen=True)
class Retarget:
    """Retarget motions to your own character: any skeleton in .glb, .gltf, .fbx, .bvh or .asf.

    The joint names of Mixamo, Unreal, Unity, VRM, Rigify, Daz, Character Creator, Biped, Xsens,
    OptiTrack, Rokoko, ARKit, CMU and SMPL are known; draft a joint map for others. FBX goes
    through your Blender.

    Example: latentmotion retarget walk.npz --to character.glb -o walking.glb
    """

    to: Path
    """The character: .glb, .gltf, .fbx, .bvh or .asf."""
    files: options.Files = ()
    """Motion files; each motion in them becomes an animation."""
    output: options.OptionalOutput = None
    """File to write: .glb, .gltf or .fbx for the character with the animations added, .bvh for its
    skeleton (one file per motion)."""
    map: options.JointMapFile = None
    draft_map: options.DraftMapFile = None
    root_motion: transfer.RootMotion = "pelvis"
    """What the path along the floor moves: the pelvis, the root bone of a rig that has one above
    the pelvis, as Unreal expects, or nothing (in place)."""
    fps: float | None = None
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
        if self.fps is not None:
            check_fps(self.fps)
        check_writable(self.output)
        rig = read_rig(self.to, None if self.map is None else load_joint_map(self.map))
        transfer.check_output(rig, self.output)
        if self.root_motion == "root":
            transfer.check_root_bone(rig)
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
        written = transfer.write(self.output, rig, motions, self.fps, names, self.root_motion)
        print("\n".join(f"wrote {path}" for path in written))


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
