"""`latentmotion set`: clips of a state machine, in one file for a game engine or a character."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from latentmotion import formats
from latentmotion.cli import loading, options
from latentmotion.control.direct import sliding_in_contact
from latentmotion.control.states import generate_states, parse_state
from latentmotion.engine.backend import ExecutionOptions
from latentmotion.errors import InputError
from latentmotion.formats.engines import engines, for_engine, write_godot, write_unity
from latentmotion.kinematics.skeleton import check_fps
from latentmotion.model.card import DEFAULT
from latentmotion.motion import Motion
from latentmotion.retarget import read_rig, transfer
from latentmotion.retarget.rig import SourceCharacter
from latentmotion.storage.files import cache_folder, write_file

# Presets that write folders, and the ending of the figure in them.
_FOLDERS = {"godot": ".glb", "unity": ".fbx"}


@dataclass(frozen=True)
class ClipSet:
    """Make clips of a state machine: loops and single moves that begin and end in one pose.

    Beside the file: .events.csv (when feet touch the floor, for notifies and animation events) and
    .set.json (speeds, lengths, loops, root motion). With a folder in place of a file, a figure with
    all that Godot 4 or Unity need to import it (--preset godot or unity).

    Examples:
        latentmotion set -o hero.glb --states idle walk run "turn left 90" "turn right 180" jump
        latentmotion set -o hero.fbx --to character.fbx --states idle walk@1.4 run@3.5
        latentmotion set -o game/hero --preset godot --states idle walk run
    """

    output: Annotated[Path, arg(aliases=["-o"])]
    """File to write: .glb, .gltf or .fbx with a clip for each state; .bvh, a file for each; or a
    folder for Godot or Unity."""
    states: tuple[str, ...] = ("idle", "walk", "run")
    """States: idle, walk, run, jog, "walk backward", jump, wave, kick, punch, "turn left 90", or
    NAME=SENTENCE, NAME=loop:SENTENCE. walk@1.4 is a loop at 1.4 m/s."""
    to: Path | None = None
    """Your character: .glb, .gltf, .vrm, .fbx or .bvh; by default the mannequin."""
    preset: formats.EngineName = "unity"
    """Names of the mannequin's bones; its root bone carries the root motion."""
    fps: float = 30.0
    """Frames per second of the clips."""
    seed: options.Seed = 0
    takes: int = 4
    """Loops of each length, and single moves, that are compared."""
    model: str = DEFAULT
    """Name or folder of the model."""
    threads: options.Threads = None

    def run(self) -> None:
        """Generates the clips and writes them.

        Raises:
            InputError: A state, a number or the file cannot be used.
            LatentMotionError: The character or the model cannot be read.
        """
        states = [parse_state(text) for text in self.states]
        check_fps(self.fps)
        if self.takes < 1:
            raise InputError(f"--takes {self.takes}: expected 1 or more")
        output = self.output
        if not output.suffix:
            if self.preset not in _FOLDERS:
                expected = "a file such as hero.glb; a folder is for --preset godot or unity"
                raise InputError(f"-o {output}: --preset {self.preset} expects {expected}")
            output = output / (output.name + _FOLDERS[self.preset])
        options.check_outputs(
            [output if output == self.output else output.parent.with_suffix(output.suffix)]
        )
        rig = read_rig(self.to) if self.to is not None else None
        if rig is not None:
            transfer.check_output(rig, output)
        elif output.suffix.lower() not in engines()[self.preset].endings:
            expected = " or ".join(engines()[self.preset].endings)
            raise InputError(f"--preset {self.preset}: {output} is none of {expected}")
        computing = ExecutionOptions(options.AUTO)
        generator = loading.load_generator(
            self.model, "auto", self.threads, None, computing, cache_folder()
        )
        clips = generate_states(generator, states, self.seed, self.takes)
        clips, scale = [clip.resampled(self.fps) for clip in clips], 1.0
        output.parent.mkdir(exist_ok=True)
        if rig is None:
            written = formats.save(output, [for_engine(clip, self.preset) for clip in clips])
            bone = engines()[self.preset].root
        else:
            root: transfer.RootMotion = "root" if rig.root_motion_bone else "pelvis"
            names = [state.name for state in states]
            written = transfer.write(output, rig, clips, None, names, root)
            bone = rig.skeleton.names[0] if rig.root_motion_bone else ""
            scale = rig.leg / SourceCharacter.of(clips[0]).leg  # it moves at the scale of its legs
        entries, tables = _write_tables(output, clips, scale)
        written += tables
        if output != self.output:
            if self.preset == "godot":
                written += write_godot(output, entries, bone, self.fps)
            else:
                written += write_unity(output, entries, bone)
        for clip in clips:
            about = clip.metadata
            kind = "loop" if about.get("loop") else f"turns {about['degrees']:g}°"
            steps = sum(event["event"].endswith("down") for event in about["events"])
            print(
                f"{about['state']}: {(len(clip) - 1) / clip.fps:.2f} s, {kind}, "
                f"{scale * about['speed']:.2f} m/s, {steps} steps, feet slide "
                f"{1e2 * sliding_in_contact(clip):.1f} cm/s"
            )
        options.print_written(written)


def _write_tables(
    output: Path, clips: Sequence[Motion], scale: float
) -> tuple[list[dict[str, Any]], list[Path]]:
    """Writes events as CSV, and what a state machine has to know of the clips as JSON."""
    lines = ["clip,event,seconds,frame"]
    entries: list[dict[str, Any]] = []
    for clip in clips:
        about, fps = clip.metadata, clip.fps
        for event in about["events"]:
            frame = round(event["time"] * fps)
            lines.append(f"{about['state']},{event['event']},{event['time']:.4f},{frame}")
        step = (scale * (clip.joints[-1, 0] - clip.joints[0, 0])).tolist()
        entries.append(
            {
                "state": about["state"],
                "prompt": clip.caption,
                "loop": about.get("loop", False),
                "seconds": round((len(clip) - 1) / fps, 4),
                "fps": fps,
                "speed": round(scale * about["speed"], 4),
                "root_motion": {
                    "x": round(step[0], 4),
                    "z": round(step[2], 4),
                    "degrees": about["degrees"],
                },
                "events": about["events"],
            }
        )
    table, events = output.with_suffix(".set.json"), output.with_suffix(".events.csv")
    content = {"format": 1, "clips": entries}
    for path, text in ((table, json.dumps(content, indent=1)), (events, "\n".join(lines))):
        write_file(path, text + "\n")
    return entries, [table, events]
