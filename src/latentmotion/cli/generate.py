"""`latentmotion generate`: prompts to motion files."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from latentmotion import formats
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.cli import loading, options
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import check_fps
from latentmotion.model.card import DEFAULT, find_or_download, read_card
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.progress import counted
from latentmotion.ranking.best import usual_takes
from latentmotion.storage import files, reading

if TYPE_CHECKING:
    from latentmotion.control.goals import Goal
    from latentmotion.control.scene import Scene
    from latentmotion.diffusion.condition import TextEncoder

_OUTPUT = (
    f"Files to write; the extension selects the format: {' '.join(formats.ENDINGS)}. "
    "By default a web page, motion.html."
)


@dataclass(frozen=True)
class Cleaning:
    """What becomes of the motion once it is generated (docs/guide/cleanup.md)."""

    clean: bool = True
    """Clean up the motion: hold standing feet, put the figure on the floor, remove jitter."""
    exact_count: bool = True
    """Make a motion do an act as often as its sentence says, such as "jumps three times". It gets
    shorter or longer; with --seconds it stays as it is."""
    exact_turn: bool = True
    """Make a motion turn by the degrees that its sentence names, such as "turns around"."""
    in_place: bool = False
    """Remove the root's path along the floor, as game engines expect."""

    def steps(self) -> CleanUp | None:
        """Returns the steps of the clean-up: none with `--no-clean`."""
        if self.in_place and not self.clean:
            raise InputError("--in-place is a step of the clean-up; leave --no-clean out")
        steps = CleanUp(self.exact_count, self.exact_turn, in_place=self.in_place)
        return steps if self.clean else None


@dataclass(frozen=True)
class Directing:
    """Where joints, body and path have to be, and several prompts (docs/guide/control.md)."""

    reach: options.Goals = ()
    """Goals of joints: JOINT@SECONDS=X,Y,Z in meters, e.g. right_wrist@2.5=.3,1.4,2.1; _ leaves a
    coordinate free. A motion starts at 0,0 and faces +z; y is up. right_hand@2-4=… holds from 2 to
    4 s (hand is the palm; also fingertips); right_hand@0-4=left_hand:-.4,0,0 counts from a joint:
    x to the body's left, z ahead."""
    heading: options.Goals = ()
    """Directions that the body faces: DEGREES@SECONDS or DEGREES@START-END; 0 is +z, 90 is +x."""
    look_at: options.Goals = ()
    """Points that the eyes look at: X,Y,Z@SECONDS or X,Y,Z@START-END; the head turns."""
    path: str | None = None
    """Path of the pelvis: points X,Z@SECONDS with spaces between, or X,Z without times."""
    pace: tuple[float, ...] = ()
    """Meters per second along a path without times: one number, or one for each point."""
    scene: Path | None = None
    """JSON file with a prompt and goals, or with a timeline."""
    timeline: options.Goals = ()
    """Prompts that follow each other in one motion: PROMPT@SECONDS, or PROMPT for the length that
    the model predicts."""
    timeline_part: options.Goals = ()
    """What a part of the body does during the timeline: PART@START-END=PROMPT in seconds, e.g.
    "right_arm@1-3=a person waves the right hand"; parts are those of `edit --parts`."""
    loop: bool = False
    """Make seamless cycles: the last frame is the first, farther along a straight path; --in-place
    takes the path away."""
    force: bool = False
    """Write a motion that meets its goals only by flying or breaking, with a warning."""

    def read_scene(self) -> Scene | None:
        """Returns the scene of the file, or of the options of a timeline or a loop, if any."""
        if self.scene is None and not (self.timeline or self.loop):
            return None
        # Here and below: what directs motions is imported only where it is used, so that a motion
        # of a sentence alone starts a tenth of a second earlier.
        from latentmotion.control.scene import FORMAT, Scene, read_scene
        from latentmotion.control.timeline import parse_part_span, parse_span

        if self.scene is not None:
            scene = read_scene(self.scene)
            return replace(scene, loop=scene.loop or self.loop)
        spans = tuple(map(parse_span, self.timeline))
        parts = tuple(map(parse_part_span, self.timeline_part))
        return Scene(FORMAT, timeline=spans, timeline_parts=parts, loop=self.loop)

    def goals(self, scene: Scene | None) -> list[Goal]:
        """Returns the goals of the options and of the scene."""
        goals = scene.all_goals((self.scene or Path()).parent) if scene else []
        if self.pace and self.path is None:
            raise InputError("--pace is that of a path; give its points: --path")
        if not (self.reach or self.heading or self.look_at or self.path is not None):
            return goals
        from latentmotion.control.scene import parse_heading, parse_look, parse_path, parse_reach

        goals += [*map(parse_reach, self.reach), *map(parse_heading, self.heading)]
        goals += map(parse_look, self.look_at)
        return goals + ([parse_path(self.path, self.pace)] if self.path is not None else [])


@dataclass(frozen=True)
class _Sampling(options.SamplingOptions):
    """How the model samples, and what it starts from."""

    from_clips: bool = True
    """Start motions of rare movements from the nearest clips of the training data; of several takes
    every other one."""
    moves: options.Moves = ()
    prior: bool = False
    """Decode random latents of the model's VAE, without prompt and diffusion."""


@dataclass(frozen=True)
class Execution(options.ComputingOptions):
    """What runs the networks, and where (docs/guide/runtime.md)."""

    runtime: options.RuntimeChoice = "auto"
    threads: options.Threads = None
    cache: bool = True
    """Cache the text encoder's output in the user's cache folder, or in the folder that the
    environment variable LATENTMOTION_CACHE names (`off` for none)."""
    body: options.Body = None


@dataclass(frozen=True)
class Generate:
    """Turn sentences, action labels or nothing into motion files.

    Example: latentmotion generate "a person walks forward and sits down" -o walk.bvh walk.html
    """

    prompts: Annotated[Positional[tuple[str, ...]], arg(metavar="PROMPTS")] = ()
    """Descriptions of what the person does: sentences, or labels for a model of actions; each
    becomes a motion of its own. A model trained on motion alone takes none."""
    output: Annotated[options.Outputs, arg(help=_OUTPUT)] = ()
    seconds: float | None = None
    """Length of each motion; by default the model predicts it from the sentence, or it is 4."""
    seed: int | None = None
    """Seed of the first take of the first motion; later takes and motions count up from it. The
    same seed gives the same motion. By default that of --scene, or 0."""
    count: int = 1
    """Motions per prompt."""
    best_of: int | None = None
    """Takes of each motion, of which the best is kept: the one that does what its sentence asks,
    with steady feet on the floor (docs/guide/best_of.md). By default 4 of a sentence, if the model
    samples in at most 16 steps, otherwise 1."""
    fps: float | None = None
    """Frames per second of the files, e.g. 24, 25, 30, 60 or 120; by default the model's own."""
    preset: formats.EngineName | None = None
    """Write figures for other programs. unreal, unity: the engine's names of bones, root motion on
    a root bone; .glb, .gltf, .fbx and .bvh. lafan, cmu: .bvh as readers of these data sets expect
    it. 30 frames per second (cmu: 120) unless --fps says otherwise."""
    file: Annotated[Path | None, arg(aliases=["-f"])] = None
    """Text file with one prompt per line, in place of prompts."""
    model: str = DEFAULT
    """Name or folder of the model, or its id on the Hugging Face Hub, OWNER/NAME."""
    json: options.PrintJson = False
    clean_up: OmitArgPrefixes[Cleaning] = Cleaning()
    directing: OmitArgPrefixes[Directing] = Directing()
    sampling: OmitArgPrefixes[_Sampling] = _Sampling()
    execution: OmitArgPrefixes[Execution] = Execution()

    def run(self) -> None:
        """Generates and writes.

        Raises:
            InputError: A prompt, a number, an ending or a folder cannot be used.
            ModelError: The model cannot be loaded.
        """
        scene = self.directing.read_scene()
        goals = self.directing.goals(scene)
        if goals and self.sampling.prior:
            raise InputError("--prior takes no goals; leave them out")
        lines = self._checked_lines()
        wrong = [f"{self.file}:{number}: {error}" for number, _, error in lines if error]
        usable = [line for _, line, error in lines if not error]
        prompts = self._checked_prompts(scene, usable, bool(goals))
        print("".join(f"warning: {line}; left out\n" for line in wrong), end="", file=sys.stderr)
        if self.fps is not None:
            check_fps(self.fps)
        # By default a page whose name is not taken, so that nothing is overwritten.
        pages = (Path(f"motion{n}.html") for n in ("", *(f"-{n}" for n in range(2, 1000))))
        default = next((page for page in pages if not page.exists()), Path("motion.html"))
        outputs = self.output or (default,)
        options.check_outputs(outputs)
        engine = None
        if self.preset:
            from latentmotion.formats.engines import engines, for_engine

            engine = engines()[self.preset]
        for path in outputs:
            if engine and engine.endings and path.suffix.lower() not in engine.endings:
                expected = f"expected {' or '.join(engine.endings)}"
                raise InputError(f"--preset {self.preset} cannot be written as {path}; {expected}")
        motions = self._generated(prompts, scene, goals)
        fps = self.fps or (engine.fps if engine else None)
        if fps is not None:
            motions = [motion.resampled(fps) for motion in counted(motions, "resampling")]
        for motion in motions if self.clean_up.clean else []:
            print(_goal_text(motion), end="", file=sys.stderr)
        for motion in motions:
            print(_origin_text(motion), end="", file=sys.stderr)
        if self.preset:
            motions = [for_engine(motion, self.preset) for motion in motions]
        written = [file for path in outputs for file in formats.save(path, motions)]
        if self.json:
            details = [
                {"caption": m.caption, "seconds": m.seconds, "frames": len(m), "fps": m.fps}
                | dict(m.metadata)
                for m in motions
            ]
            print(json.dumps({"files": [str(p.absolute()) for p in written], "motions": details}))
        else:
            options.print_written(written)
        if wrong:
            raise InputError(f"{len(wrong)} of {len(lines)} prompts of {self.file} were left out")

    def _checked_lines(self) -> list[tuple[int, str, InputError | None]]:
        """Returns number and prompt of each line of the file, and what is wrong with it."""
        if self.file is None:
            return []
        # All lines are checked before the first motion: a mistake in line 900 is told at once, and
        # costs that line alone.
        files.read_lines(self.file, "prompt")  # raises an error where there are none
        card = read_card(find_or_download(self.model))
        lines = []
        for number, line in enumerate(map(str.strip, reading.read_text(self.file).splitlines()), 1):
            problem = None
            try:
                card.condition.check_prompt(line, card.name)
                if card.condition.prompted and not card.condition.reads_text:
                    card.prompt_condition(_no_text_encoder)([line])
            except InputError as error:
                problem = error
            if line:
                lines.append((number, line, problem))
        if all(problem for _, _, problem in lines):
            number, _, problem = lines[0]
            raise InputError(f"{self.file}:{number}: {problem}")
        return lines

    def _checked_prompts(self, scene: Scene | None, lines: list[str], goals: bool) -> list[str]:
        """Returns the prompts; for an unconditional model or a timeline an empty one."""
        for name, number in (("best-of", self.best_of), ("count", self.count)):
            if number is not None and number < 1:
                raise InputError(f"--{name} {number}: expected 1 or more")
        self.clean_up.steps()  # raises an error where they do not fit
        directing, prior = self.directing, self.sampling.prior
        several, loops = bool(scene and scene.timeline), bool(scene and scene.loop)
        if self.best_of not in (None, 1) and (several or prior):
            raise InputError(
                f"--best-of {self.best_of}: takes are scored by their one sentence; leave --prior, "
                "--timeline and scenes with a timeline out"
            )
        others = [self.prompts, self.file, prior, self.directing.scene]
        if directing.timeline and any(others):
            raise InputError(
                "--timeline has the prompts: leave prompts, --file, --prior, --scene out"
            )
        if loops and (prior or several or goals):
            raise InputError("a loop takes no goals, --timeline or --prior; leave them out")
        if directing.timeline_part and not directing.timeline:
            raise InputError("--timeline-part needs --timeline, which the whole body follows")
        if directing.scene and (self.prompts or self.file or prior):
            raise InputError("--scene has the prompt; leave prompts, --file and --prior out")
        self._refuse_unused(several, loops, goals)
        if scene and directing.scene:
            return [scene.prompt]
        if self.file is not None and self.prompts:
            raise InputError("give either prompts or --file, not both")
        typed = lines or list(self.prompts)
        if prior and typed:
            raise InputError(f"--prior takes no prompt; leave {typed[0]!r} out")
        if prior:
            return typed
        if typed:
            # The words of one sentence, typed without quotes.
            words = self.file is None and len(typed) > 2 and not any(" " in word for word in typed)
            if words and read_card(find_or_download(self.model)).condition.reads_text:
                sentence = " ".join(typed)
                print(
                    f"warning: {len(typed)} motions, one for each word; for one motion put the "
                    f'sentence in quotes: "{sentence}"',
                    file=sys.stderr,
                )
            return typed
        if directing.timeline:
            return [""]
        card = read_card(find_or_download(self.model))
        if card.condition.prompted:
            raise card.condition.no_prompt(card.name)
        reason = f"model {card.name!r} reads no prompts"
        options.refuse_unused(self.sampling, reason, "guidance", "moves")
        return [""]

    def _refuse_unused(self, timeline: bool, loop: bool, goals: bool) -> None:
        """Refuses options that have no effect beside others."""
        sampling, directing = self.sampling, self.directing
        prior, usual = "--prior decodes random latents", "by the model's own sampler"
        no_clips = not sampling.from_clips
        of_goals = ("reach", "heading", "look_at", "path", "pace")
        for applies, group, reason, *names in (
            (sampling.prior, sampling, prior, "steps", "guidance", "sampler", "moves"),
            (sampling.prior, self.execution, prior, "text_encoder"),
            (timeline, self, "the prompts of a timeline have lengths of their own", "seconds"),
            (timeline, sampling, f"a timeline is sampled from noise {usual}", "sampler", "moves"),
            (timeline, directing, "a timeline takes no goals", *of_goals),
            (loop, sampling, f"a loop starts from noise, {usual}", "sampler", "moves"),
            (goals, sampling, "a motion with goals starts from noise", "moves"),
            (not goals, directing, "there are no goals", "force"),
            (no_clips, sampling, "--no-from-clips starts all motions from noise", "moves"),
            (sampling.steps == 1, sampling, "a motion of one step starts from noise", "moves"),
        ):
            if applies:
                options.refuse_unused(group, reason, *names)

    def _generated(
        self, prompts: list[str], scene: Scene | None, goals: list[Goal]
    ) -> list[Motion]:
        """Loads the model and generates the motions."""
        execution, sampling, directing = self.execution, self.sampling, self.directing
        computing = execution.execution
        body = None
        if execution.body:
            from latentmotion.kinematics.smpl import load_smpl
            from latentmotion.representation.smpl import representation_of

            body = representation_of(load_smpl(execution.body))
        steps, threads = self.clean_up.steps(), execution.threads
        if sampling.prior:
            prior = loading.load_prior(self.model, execution.runtime, threads, computing)
            seeds = range(self.seed or 0, (self.seed or 0) + self.count)
            motions = replace(prior, body=body).batch(self.seconds, seeds)
            return clean_batch(motions, steps) if steps else motions
        cache = files.cache_folder() if execution.cache else None
        encoder = execution.text_encoder
        generator = loading.load_generator(
            self.model, execution.runtime, threads, encoder, computing, cache
        )
        generator = replace(generator, body=body).with_moves(*sampling.moves)
        seed = (scene.seed if scene and self.seed is None else self.seed) or 0
        if scene and scene.timeline:
            from latentmotion.control.scene import loop_or_timeline

            settings, seeds = (sampling.steps, sampling.guidance), range(seed, seed + self.count)
            motions = [loop_or_timeline(generator, scene, n, *settings) for n in seeds]
            return clean_batch(motions, steps) if steps else motions
        seconds = scene.seconds if scene and self.seconds is None else self.seconds
        if scene and scene.loop:
            return self._cycles(generator, prompts, seconds, seed, steps)
        repeated = [prompt for prompt in prompts for _ in range(self.count)]
        takes = self.best_of or min(usual_takes(generator.card, prompt) for prompt in prompts)
        settings = sampling.steps, sampling.guidance, sampling.sampler
        if takes == 1 and not goals:  # all prompts together, which is faster
            seeds = range(seed, seed + len(repeated))
            return generator.batch(repeated, seconds, seeds, *settings, sampling.from_clips, steps)
        # A motion's takes have the seeds behind it, so that no two motions share a take.
        settings = (*settings, goals, sampling.from_clips, takes, steps)
        return [
            generator(prompt, seconds, seed + takes * number, *settings, force=directing.force)
            for number, prompt in enumerate(repeated)
        ]

    def _cycles(
        self,
        generator: MotionPipeline,
        prompts: list[str],
        seconds: float | None,
        seed: int,
        steps: CleanUp | None,
    ) -> list[Motion]:
        """Generates loops, each the best of several takes."""
        from latentmotion.control.stream import generate_loop
        from latentmotion.ranking.best import ranked, scorer_beside

        settings, best = (self.sampling.steps, self.sampling.guidance), []
        for prompt in (prompt for prompt in prompts for _ in range(self.count)):
            takes = self.best_of or usual_takes(generator.card, prompt)
            seeds = range(seed + takes * len(best), seed + takes * (len(best) + 1))
            loops = [generate_loop(generator, prompt, seconds, n, *settings) for n in seeds]
            if takes > 1:
                scorer = scorer_beside(generator.condition)
                loops = [take.motion for take in ranked(loops, prompt, scorer, None)]
            best.append(loops[0])
        return clean_batch(best, steps) if steps else best


def _no_text_encoder() -> TextEncoder:
    raise InputError("labels need no text encoder")


def _goal_text(motion: Motion) -> str:
    """Returns how far the joints of a motion are from their goals, a line for each."""
    if "goals" not in motion.metadata:
        return ""
    from latentmotion.control.direct import named

    lines = []
    for goal in motion.metadata["goals"]:
        after, before = f"{1e3 * goal['after']:.1f} mm", f"{1e2 * goal['before']:.1f} cm"
        if goal.get("unit") == "degrees":
            after, before = (f"{goal[key]:.1f}°" for key in ("after", "before"))
        lines.append(f"{named(goal)}: {after} from its goal, {before} before it was put there\n")
    shown = lines if len(lines) <= 12 else [*lines[:11], f"… and {len(lines) - 11} more\n"]
    if "best_of" not in motion.metadata:  # of several takes the score tells it
        shown = [*shown, f"feet slide {1e2 * motion.metadata['foot_sliding']:.1f} cm/s\n"]
    return "".join(shown)


def _origin_text(motion: Motion) -> str:
    """Returns lines about the best of several takes, the reading of its sentence and its clips."""
    text = ""
    if takes := motion.metadata.get("best_of"):
        best, last = takes[0], takes[-1]
        text = (
            f"best of {len(takes)}: seed {best['seed']}, score {best['score']:.3f} (worst "
            f"{last['score']:.3f}): text {best['text']:.3f}, feet slide "
            f"{1e2 * best['sliding']:.1f} cm/s, {1e2 * best['penetration']:.1f} cm below the "
            f"floor, jerk {best['jerk']:.0f} m/s³\n"
        )
    if read_as := motion.metadata.get("read_as"):
        text += f'read as "{read_as}"\n'
    return text + "".join(
        f'starts from clip {clip["clip"]} of {clip["source"]}, "{clip["caption"]}"; its owner and '
        "terms are in the file\n"
        for clip in motion.metadata.get("from_clips", ())
    )
