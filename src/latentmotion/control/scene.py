"""Scene files: a prompt with goals as JSON, strict, versioned; `scene.schema.json` describes them.

    {"format": 1, "prompt": "a person walks", "seconds": 4, "seed": 7,
     "path": {"points": [[0, 0], [0, 2], [1, 3]], "at": [0, 2, 3.9]},
     "goals": [{"joint": "right_hand", "at": 2.5, "until": 3.5, "to": [0.3, 1.4, 2.1]}],
     "headings": [{"at": 3.9, "degrees": 90}],
     "looks": [{"at": 1, "until": 2, "to": [2, 1.6, 2]}],
     "poses": [{"at": 0, "file": "stand.npz", "frame": 0}]}

Seconds, meters, y up; null leaves a coordinate free. Files of poses are found from the scene's
folder.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.control.generator import Generator
from latentmotion.control.goals import Goal, Heading, LookAt, Pose, Reach, RootPath
from latentmotion.control.stream import generate_loop
from latentmotion.control.timeline import PartSpan, Span, generate_timeline
from latentmotion.errors import InputError
from latentmotion.motion import Motion
from latentmotion.storage.configuration import read_json
from latentmotion.storage.limits import MOST_GOALS, MOST_SPANS

FORMAT = 1  # Version of scene files that this code reads.

SCHEMA_FILE = Path(__file__).with_name("scene.schema.json")  # JSON Schema of scene files.


@dataclass(frozen=True)
class ScenePath:
    """The path of the pelvis."""

    points: tuple[tuple[float, float], ...]
    """x and z of each point, meters."""
    at: tuple[float, ...] | None = None
    """Seconds at which each is passed; by default the whole path takes the whole motion."""
    pace: tuple[float, ...] | None = None
    """In place of times: meters per second, one number or one for each point."""


@dataclass(frozen=True)
class ScenePose:
    """All joints are where they are in a frame of a motion file."""

    at: float  # Seconds.
    file: str  # The motion file, from the scene's folder.
    frame: int = 0  # Its frame; a negative one counts from the end.


@dataclass(frozen=True)
class Scene:
    """A prompt with goals, or a timeline of prompts."""

    format: int  # Version of the file: 1.
    prompt: str = ""  # What the person does.
    seconds: float | None = None  # Length of the motion; by default as the model predicts it.
    seed: int | None = None  # Seed of the noise; by default 0.
    path: ScenePath | None = None  # The path of the pelvis.
    goals: tuple[Reach, ...] = ()  # Places of joints.
    headings: tuple[Heading, ...] = ()  # Directions of the body.
    looks: tuple[LookAt, ...] = ()  # Points that the eyes look at.
    poses: tuple[ScenePose, ...] = ()  # Whole poses.
    # Prompts one after the other, in place of prompt, seconds and goals.
    timeline: tuple[Span, ...] = ()
    timeline_parts: tuple[PartSpan, ...] = ()  # What parts of the body do during the timeline.
    # Whether it is a seamless cycle: the last frame is the first, farther along its path.
    loop: bool = False

    def all_goals(self, folder: Path = Path()) -> list[Goal]:
        """Returns the goals for `MotionPipeline`, poses read.

        Args:
            folder: Where files of poses are.

        Raises:
            InputError: A file cannot be read.
        """
        path = [] if self.path is None else [RootPath(**vars(self.path))]
        poses = [Pose(pose.at, Motion.load(folder / pose.file), pose.frame) for pose in self.poses]
        return [*path, *self.goals, *self.headings, *self.looks, *poses]


def read_scene(path: Path) -> Scene:
    """Reads a scene file.

    Raises:
        InputError: It is missing or no JSON, a key is unknown, missing or of the wrong type (the
            message has the nearest name), or it is of another version.
    """
    return checked(read_json(Scene, path), path)


def checked(scene: Scene, where: object) -> Scene:
    """Returns a scene that is of one kind, and not too large.

    Args:
        scene: The scene.
        where: What it is from, for errors.

    Raises:
        InputError: It is of another version, of several kinds, or has too many goals or prompts.
    """
    if scene.format != FORMAT:
        raise InputError(f"{where}: format {scene.format}, expected {FORMAT}; update latentmotion")
    most = dict.fromkeys(("goals", "headings", "looks", "poses"), MOST_GOALS)
    for name, count in {**most, "timeline": MOST_SPANS, "timeline_parts": MOST_SPANS}.items():
        if len(getattr(scene, name)) > count:
            size = f"{len(getattr(scene, name)):,} {name}"
            raise InputError(f"{where}: {size}, expected at most {count}")
    if scene.path is not None and len(scene.path.points) > MOST_GOALS:
        size = f"a path of {len(scene.path.points):,} points"
        raise InputError(f"{where}: {size}, expected at most {MOST_GOALS}; leave some out")
    single = scene.prompt or scene.seconds is not None or scene.path or scene.goals
    if scene.timeline and (single or scene.headings or scene.looks or scene.poses):
        raise InputError(f"{where}: a timeline has no prompt, length or goals")
    if scene.loop and (scene.timeline or scene.path or scene.goals or scene.poses):
        raise InputError(f"{where}: a loop has no timeline or goals")
    if scene.timeline_parts and not scene.timeline:
        raise InputError(f"{where}: timeline_parts needs a timeline that the whole body follows")
    return scene


def loop_or_timeline(
    generator: Generator,
    scene: Scene,
    seed: int,
    steps: int | None = None,
    guidance: float | None = None,
) -> Motion:
    """Generates the motion of a scene that is a loop or a timeline, not cleaned up."""
    settings = (seed, steps, guidance)
    if scene.loop:
        return generate_loop(generator, scene.prompt, scene.seconds, *settings)
    return generate_timeline(generator, scene.timeline, *settings, scene.timeline_parts)


def parse_reach(text: str) -> Reach:
    """Reads `right_hand@2.5-4=.3,1.4,2.1`, as the command line has it; `_` leaves one free.

    A joint and a colon before the place, `left_hand:-.4,0,0`, are what it counts from.

    Raises:
        InputError: It is not of that form.
    """
    try:
        name, _, rest = text.partition("@")
        at, _, place = rest.partition("=")
        origin, _, place = place.rpartition(":")
        x, y, z = (None if value.strip() == "_" else float(value) for value in place.split(","))
        start, until = _times(at)
        return Reach(name.strip(), start, (x, y, z), until, origin.strip() or None)
    except ValueError as error:
        raise InputError(
            f"--reach {text}: expected JOINT@SECONDS=X,Y,Z or JOINT@START-END=X,Y,Z, such as "
            "right_hand@2.5-4=.3,1.4,2.1; _ leaves a coordinate free, and JOINT:X,Y,Z counts from "
            "a joint"
        ) from error


def parse_heading(text: str) -> Heading:
    """Reads `90@2.5` or `90@2.5-4`, degrees and seconds.

    Raises:
        InputError: It is not of that form.
    """
    try:
        degrees, at = text.split("@")
        start, until = _times(at)
        return Heading(start, float(degrees), until)
    except ValueError as error:
        raise InputError(
            f"--heading {text}: expected DEGREES@SECONDS or DEGREES@START-END, such as 90@2.5"
        ) from error


def parse_look(text: str) -> LookAt:
    """Reads `2,1.6,2@1-3`, a point and seconds.

    Raises:
        InputError: It is not of that form.
    """
    try:
        place, at = text.split("@")
        x, y, z = map(float, place.split(","))
        start, until = _times(at)
        return LookAt(start, (x, y, z), until)
    except ValueError as error:
        raise InputError(
            f"--look-at {text}: expected X,Y,Z@SECONDS or X,Y,Z@START-END, such as 2,1.6,2@1-3"
        ) from error


def _times(text: str) -> tuple[float, float | None]:
    """Reads `2.5` or `2.5-4`."""
    start, dash, end = text[1:].partition("-")
    return float(text[:1] + start), float(end) if dash else None


def parse_path(text: str, pace: tuple[float, ...] = ()) -> RootPath:
    """Reads `0,0@0 0,2@2 1,3@4`, as the command line has it, or the points without times.

    Args:
        text: The points.
        pace: Meters per second, in place of times.

    Raises:
        InputError: It is not of that form.
    """
    points, times = [], []
    try:
        for word in text.split():
            place, _, at = word.partition("@")
            x, z = place.split(",")
            points.append((float(x), float(z)))
            times += [float(at)] if at else []
    except ValueError as error:
        raise InputError(f"--path: {word!r}: expected X,Z or X,Z@SECONDS, such as 0,2@2") from error
    if times and len(times) != len(points):
        raise InputError(f"--path: {len(times)} of {len(points)} points have times: all or none")
    return RootPath(points, times or None, pace or None)
