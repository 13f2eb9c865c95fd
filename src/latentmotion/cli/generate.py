"""`latentmotion generate`: prompts to motion files; also the loading of models for all verbs."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cleanup import CleanUp
from latentmotion.cli import options
from latentmotion.engine.backend import ON_CPU, ExecutionOptions
from latentmotion.engine.prior import MotionPrior
from latentmotion.engine.session import open_decoder, thread_limit
from latentmotion.errors import InputError, MissingExtraError, ModelError
from latentmotion.formats.engines import ENGINES, EngineName, for_engine
from latentmotion.kinematics import smpl
from latentmotion.kinematics.skeleton import check_fps
from latentmotion.model.card import DEFAULT, find_or_download, read_card
from latentmotion.motion import Motion, cleaned
from latentmotion.pipeline import MotionPipeline
from latentmotion.progress import counted
from latentmotion.representation.smpl import representation_of
from latentmotion.storage.files import cache_folder, check_writable, read_lines
from latentmotion.storage.reading import read_text

if TYPE_CHECKING:
    from latentmotion.condition.interface import TextEncoder
    from latentmotion.control.goals import Goal
    from latentmotion.control.scene import Scene

_OUTPUT = (
    f"Files to write; the extension selects the format: {' '.join(formats.ENDINGS)}. "
    "By default a web page, motion.html."
)


@dataclass(frozen=True)
class Generate:
    """Turn sentences, action labels or nothing into motion files.

    Example: latentmotion generate "a person walks forward and sits down" -o walk.bvh walk.html
    """

    prompts: Annotated[Positional[tuple[str, ...]], arg(metavar="PROMPTS")] = ()
    """Descriptions of what the person does: sentences, or labels for a model of actions; each
    becomes a motion of its own. A model trained on motion alone takes none."""
    file: Annotated[Path | None, arg(aliases=["-f"])] = None
    """Text file with one prompt per line, in place of prompts."""
    seconds: float | None = None
    """Length of each motion; by default the model predicts it from the sentence, or it is 4."""
    count: int = 1
    """Motions per prompt."""
    best_of: int | None = None
    """Takes of each motion, of which the best is kept: the one that does what its sentence asks,
    with steady feet on the floor (docs/guide/best_of.md). By default 4 of a sentence, if the model
    samples in at most 16 steps, otherwise 1."""
    seed: int = 0
    """Seed of the first take of the first motion; later takes and motions count up from it. The
    same seed gives the same motion."""
    output: Annotated[options.Outputs, arg(help=_OUTPUT)] = ()
    model: str = DEFAULT
    """Name or folder of the model, or its id on the Hugging Face Hub, OWNER/NAME."""
    prior: bool = False
    """Decode random latents of the model's VAE, without prompt and diffusion."""
    steps: options.Steps = None
    guidance: options.Guidance = None
    sampler: options.SamplerChoice = None
    from_clips: bool = True
    """Start motions of rare movements from the nearest clips of the training data; of several takes
    every other one."""
    moves: options.Moves = ()
    runtime: options.RuntimeChoice = "auto"
    threads: options.Threads = None
    cache: bool = True
    """Cache the text encoder's output in the user's cache folder, or in the folder that the
    environment variable LATENTMOTION_CACHE names (`off` for none)."""
    text_encoder: options.OptionalTextEncoder = None
    device: options.Device = options.AUTO
    precision: options.ComputePrecision = "float32"
    launch: options.LaunchMode = "eager"
    body: options.Body = None
    reach: options.Goals = ()
    """Goals of joints: JOINT@SECONDS=X,Y,Z in meters, e.g. right_wrist@2.5=.3,1.4,2.1; _ leaves a
    coordinate free. A motion starts at 0,0 and faces +z; y is up (docs/guide/control.md)."""
    heading: options.Goals = ()
    """Directions that the body faces: DEGREES@SECONDS; 0 is +z, 90 is +x."""
    path: str | None = None
    """Path of the pelvis: points X,Z@SECONDS with spaces between, or X,Z without times."""
    scene: Path | None = None
    """JSON file with a prompt and goals, or with a timeline."""
    timeline: options.Goals = ()
    """Prompts that follow each other in one motion: PROMPT@SECONDS, or PROMPT for the length that
    the model predicts."""
    timeline_part: options.Goals = ()
    """What a part of the body does during the timeline: PART@START-END=PROMPT in seconds, e.g.
    "right_arm@1-3=a person waves the right hand"; parts are those of `edit --parts`."""
    clean: bool = True
    """Clean up the motion: hold standing feet, put the figure on the floor, remove jitter
    (docs/guide/cleanup.md)."""
    exact_count: bool = True
    """As part of the clean-up, make a motion do an act as often as its sentence says, such as
    "jumps three times". It gets shorter or longer; with --seconds it stays as it is."""
    exact_turn: bool = True
    """As part of the clean-up, make a motion turn by the degrees that its sentence names, such as
    "turns around"."""
    in_place: bool = False
    """Remove the root's path along the floor, as game engines expect."""
    preset: EngineName | None = None
    """Write figures for other programs. unreal, unity: the engine's names of bones, root motion on
    a root bone; .glb, .gltf, .fbx and .bvh. lafan, cmu: .bvh as readers of these data sets expect
    it. 30 frames per second (cmu: 120) unless --fps says otherwise."""
    fps: float | None = None
    """Frames per second of the files, e.g. 24, 25, 30, 60 or 120; by default the model's own."""
    json: options.PrintJson = False

    def run(self) -> None:
        """Generates and writes.

        Raises:
            InputError: A prompt, a number, an ending or a folder cannot be used.
            ModelError: The model cannot be loaded.
        """
        scene = self._scene()
        goals = self._goals(scene)
        lines = self._checked_lines()
        wrong = [f"{self.file}:{number}: {error}" for number, _, error in lines if error]
        prompts = self._checked_prompts(scene, [line for _, line, error in lines if not error])
        print("".join(f"warning: {one}; left out\n" for one in wrong), end="", file=sys.stderr)
        if self.fps is not None:
            check_fps(self.fps)
        # By default a page whose name is not taken, so that nothing is overwritten.
        pages = (Path(f"motion{n}.html") for n in ("", *(f"-{n}" for n in range(2, 1000))))
        default = next((page for page in pages if not page.exists()), Path("motion.html"))
        outputs = self.output or (default,)
        for path in outputs:
            formats.check_ending(path)
            check_writable(path)
            endings = ENGINES[self.preset].endings if self.preset else ()
            if endings and path.suffix.lower() not in endings:
                expected = f"expected {' or '.join(endings)}"
                raise InputError(f"--preset {self.preset} cannot be written as {path}; {expected}")
        motions = self._generated(prompts, scene, goals)
        if self.clean:
            motions = cleaned(motions, self._clean_up())
        fps = self.fps if self.fps or not self.preset else ENGINES[self.preset].fps
        if fps is not None:
            motions = [motion.resampled(fps) for motion in counted(motions, "resampling")]
        for motion in motions if self.clean else []:
            print(_goal_text(motion), end="", file=sys.stderr)
        for motion in motions:
            print(_take_text(motion) + _clip_text(motion), end="", file=sys.stderr)
        if self.preset:
            motions = [for_engine(motion, self.preset) for motion in motions]
        written = [file for path in outputs for file in formats.save(path, motions)]
        if self.json:
            self._print_json(motions, written)
        else:
            print("\n".join(f"wrote {path}" for path in written))
        if wrong:
            raise InputError(f"{len(wrong)} of {len(lines)} prompts of {self.file} were left out")

    def _print_json(self, motions: list[Motion], written: list[Path]) -> None:
        details = [
            {"caption": m.caption, "seconds": m.seconds, "frames": len(m), "fps": m.fps}
            | dict(m.metadata)
            for m in motions
        ]
        print(json.dumps({"files": [str(p.absolute()) for p in written], "motions": details}))

    def _clean_up(self) -> CleanUp:
        """Returns the steps of the clean-up: none with `--no-clean`."""
        if not self.clean:
            return CleanUp(False, False, smooth=False, bones=False, floor=False, feet=False)
        return CleanUp(self.exact_count, self.exact_turn, in_place=self.in_place)

    def _scene(self) -> Scene | None:
        from latentmotion.control.scene import read_scene

        return read_scene(self.scene) if self.scene else None

    def _goals(self, scene: Scene | None) -> list[Goal]:
        from latentmotion.control.scene import parse_heading, parse_path, parse_reach

        goals = scene.all_goals(self.scene.parent) if scene and self.scene else []
        goals += [*map(parse_reach, self.reach), *map(parse_heading, self.heading)]
        goals += [parse_path(self.path)] if self.path is not None else []
        if goals and self.prior:
            raise InputError("--prior takes no goals; leave them out")
        return goals

    def _checked_lines(self) -> list[tuple[int, str, InputError | None]]:
        """Returns number and prompt of each line of the file, and what is wrong with it."""
        if self.file is None:
            return []
        read_lines(self.file, "prompt")  # raises an error where there are none
        card = read_card(find_or_download(self.model))
        lines = []
        for number, line in enumerate(map(str.strip, read_text(self.file).splitlines()), 1):
            error = None
            try:
                card.condition.check_prompt(line, card.name)
                if card.condition.prompted and not card.condition.reads_text:
                    card.prompt_condition(_no_text_encoder)([line])
            except InputError as found:
                error = found
            if line:
                lines.append((number, line, error))
        if all(error for _, _, error in lines):
            number, _, error = lines[0]
            raise InputError(f"{self.file}:{number}: {error}")
        return lines

    def _checked_prompts(self, scene: Scene | None, lines: list[str]) -> list[str]:
        """Returns the prompts; for an unconditional model or a timeline an empty one."""
        if self.best_of is not None and self.best_of < 1:
            raise InputError(f"--best-of {self.best_of}: expected 1 or more")
        several = bool(self.timeline) or (scene is not None and bool(scene.spans()))
        if self.best_of not in (None, 1) and (several or self.prior):
            raise InputError(
                f"--best-of {self.best_of}: takes are scored by their one sentence; leave --prior, "
                "--timeline and scenes with a timeline out"
            )
        alone = [self.prompts, self.file, self.prior, self.scene, self.reach, self.heading]
        if self.timeline and any([*alone, self.path, self.seconds, self.sampler]):
            raise InputError(
                "--timeline stands alone: leave prompts, --file, --prior, --scene, --seconds, "
                "--sampler and goals out"
            )
        if self.timeline_part and not self.timeline:
            raise InputError("--timeline-part needs --timeline, which the whole body follows")
        if scene is not None and (self.prompts or self.file or self.prior):
            raise InputError("--scene has the prompt; leave prompts, --file and --prior out")
        if scene is not None:
            return [scene.prompt]
        if self.file is not None and self.prompts:
            raise InputError("give either prompts or --file, not both")
        if self.count < 1:
            raise InputError(f"--count {self.count}: expected 1 or more")
        if self.in_place and not self.clean:
            raise InputError("--in-place is a step of the clean-up; leave --no-clean out")
        given = lines or list(self.prompts)
        if self.prior and given:
            raise InputError(f"--prior takes no prompt; leave {given[0]!r} out")
        if self.prior:
            return given
        if given:
            self._warn_of_words(given)
            return given
        if self.timeline:
            return [""]
        card = read_card(find_or_download(self.model))
        if card.condition.prompted:
            raise card.condition.no_prompt(card.name)
        return [""]

    def _warn_of_words(self, given: list[str]) -> None:
        """Warns where the words of one sentence seem to have become prompts of their own."""
        words = self.file is None and len(given) > 2 and not any(" " in word for word in given)
        if words and read_card(find_or_download(self.model)).condition.reads_text:
            sentence = " ".join(given)
            print(
                f"warning: {len(given)} motions, one for each word; for one motion put the "
                f'sentence in quotes: "{sentence}"',
                file=sys.stderr,
            )

    def _generated(
        self, prompts: list[str], scene: Scene | None, goals: list[Goal]
    ) -> list[Motion]:
        """Loads the model and generates the motions."""
        from latentmotion.control.timeline import parse_part_span, parse_span
        from latentmotion.ranking.best import usual_takes

        execution = ExecutionOptions(self.device, self.precision, self.launch)
        body = representation_of(smpl.load_smpl(self.body)) if self.body else None
        if self.prior:
            prior = load_prior(self.model, self.runtime, self.threads, execution)
            seeds = range(self.seed, self.seed + self.count)
            return replace(prior, body=body).batch(self.seconds, seeds)
        generator = load_generator(
            self.model,
            self.runtime,
            self.threads,
            self.text_encoder,
            execution,
            cache_folder() if self.cache else None,
        )
        repeated = [prompt for prompt in prompts for _ in range(self.count)]
        seconds = scene.seconds if scene and self.seconds is None else self.seconds
        first = scene.seed if scene and scene.seed is not None else self.seed
        seeds = range(first, first + len(repeated))
        generator = replace(generator, body=body).with_moves(*self.moves)
        sampling = self.steps, self.guidance, self.sampler
        spans = scene.spans() if scene else [parse_span(text) for text in self.timeline]
        parts = scene.part_spans() if scene else [*map(parse_part_span, self.timeline_part)]
        if spans:
            return [
                generator.timeline(spans, seed, self.steps, self.guidance, parts)
                for seed in range(first, first + self.count)
            ]
        takes = self.best_of or min(usual_takes(generator.card, prompt) for prompt in prompts)
        if takes > 1:
            named = dict(zip(("steps", "guidance", "sampler"), sampling, strict=True))
            settings = {"seconds": seconds, "goals": goals, "clean_up": self._clean_up(), **named}
            settings["from_clips"] = self.from_clips
            return [
                generator.best(prompt, takes, seed=first + takes * number, **settings)
                for number, prompt in enumerate(repeated)
            ]
        if not goals:
            return generator.batch(repeated, seconds, seeds, *sampling, self.from_clips)
        return [
            generator(prompt, seconds, seed, *sampling, goals)
            for prompt, seed in zip(repeated, seeds, strict=True)
        ]


def _no_text_encoder() -> TextEncoder:
    raise InputError("labels need no text encoder")


def _goal_text(motion: Motion) -> str:
    """Returns how far the joints of a motion are from their goals, a line for each."""
    if not motion.goals:
        return ""
    lines = [
        f"{goal['joint']} at {goal['at']:g} s: {1e3 * goal['after']:.1f} mm from its goal, "
        f"{1e2 * goal['before']:.1f} cm before it was put there\n"
        for goal in motion.metadata["goals"]
    ]
    shown = lines if len(lines) <= 12 else [*lines[:11], f"… and {len(lines) - 11} more\n"]
    sliding = 1e2 * motion.metadata["foot_sliding"]
    return "".join([*shown, f"feet that stand slide {sliding:.1f} cm/s\n"])


def _take_text(motion: Motion) -> str:
    """Returns a line about the take that was the best of several."""
    takes = motion.metadata.get("best_of")
    if not takes:
        return ""
    best, last = takes[0], takes[-1]
    return (
        f"best of {len(takes)}: seed {best['seed']}, score {best['score']:.3f} (worst "
        f"{last['score']:.3f}): text {best['text']:.3f}, feet slide {1e2 * best['sliding']:.1f} "
        f"cm/s, {1e2 * best['penetration']:.1f} cm below the floor, jerk {best['jerk']:.0f} m/s³\n"
    )


def _clip_text(motion: Motion) -> str:
    """Returns a line for each clip that a motion starts from."""
    return "".join(
        f'starts from clip {clip["clip"]} of {clip["source"]}, "{clip["caption"]}"; its owner and '
        "terms are in the file\n"
        for clip in motion.metadata.get("from_clips", ())
    )


def located(execution: ExecutionOptions) -> ExecutionOptions:
    """Returns options with the device `auto` replaced by a GPU, if there is one, or the CPU."""
    if execution.device != options.AUTO:
        return execution
    default = import_module("latentmotion.gpu.device").default_device()
    return replace(execution, device=default)


def load_generator(
    model: str | Path,
    runtime: options.Runtime = "auto",
    threads: int | None = None,
    text_encoder: str | None = None,
    execution: ExecutionOptions = ON_CPU,
    cache: Path | None = None,
) -> MotionPipeline:
    """Loads a model, exported or not.

    Args:
        model: Name, folder or hub id.
        runtime: Engine of the networks.
        threads: Maximum number of threads; PyTorch's are set for the whole process.
        text_encoder: Text encoder if the folder has none, as for `latentmotion train denoiser`.
        execution: Device, precision and launch mode; only PyTorch has other ones than the CPU's.
        cache: Folder in which embeddings of an exported model's prompts are kept.

    Raises:
        InputError: The engine does not support the execution options or the text encoder.
        ModelError: There is no such model, it is damaged, or it needs PyTorch, which is missing.
    """
    folder = find_or_download(model)
    card = read_card(folder)
    if not card.denoiser:
        raise ModelError(
            f"{model} has a VAE but no denoiser: sample its prior by --prior, or train the "
            "diffusion: latentmotion train denoiser"
        )
    runtime = _runtime_for(execution, runtime, text_encoder)
    if runtime != "pytorch" and (folder / "denoiser.onnx").is_file():
        return MotionPipeline.from_pretrained(folder, runtime, threads, cache)
    backend = _pytorch(folder, runtime, threads)
    encoder = backend.text_encoder_named(text_encoder) if text_encoder else None
    return backend.torch_pipeline(folder, encoder, located(execution))


def load_prior(
    model: str | Path,
    runtime: options.Runtime = "auto",
    threads: int | None = None,
    execution: ExecutionOptions = ON_CPU,
) -> MotionPrior:
    """Loads a model's VAE, exported or not, to sample its prior.

    Raises:
        InputError: The engine does not support the execution options.
        ModelError: There is no such model, it is damaged, or it needs PyTorch, which is missing.
    """
    folder, runtime = find_or_download(model), _runtime_for(execution, runtime)
    if runtime != "pytorch" and (folder / "decoder.onnx").is_file():
        card = read_card(folder)
        return MotionPrior(card, open_decoder(card, folder, runtime, threads))
    return _pytorch(folder, runtime, threads).torch_prior(folder, located(execution))


def _runtime_for(
    execution: ExecutionOptions, runtime: options.Runtime, text_encoder: str | None = None
) -> options.Runtime:
    """Returns the runtime, or PyTorch if the options need it."""
    plain = execution in (ON_CPU, ExecutionOptions(options.AUTO))
    if runtime == "pytorch" or (plain and text_encoder is None):
        return runtime
    if runtime == "auto":
        return "pytorch"
    if text_encoder is not None:
        raise InputError(f"the runtime {runtime} takes no --text-encoder; leave one of them out")
    raise InputError(
        f"the runtime {runtime} computes on the CPU, in float32; for {execution} leave it out"
    )


def _pytorch(folder: Path, runtime: options.Runtime, threads: int | None) -> ModuleType:
    """Returns the module of pipelines on PyTorch."""
    if find_spec("torch") is None and runtime == "pytorch":
        raise MissingExtraError("the runtime pytorch", "PyTorch", "train")
    if find_spec("torch") is None:
        raise ModelError(
            f"{folder} was not exported, and PyTorch, which could run it as it is, is not "
            "installed; run on the machine that trained it: latentmotion export, or here: "
            'pip install "latentmotion[train]"'
        )
    if runtime != "pytorch":
        print(f"{folder} has no graphs (latentmotion export); PyTorch runs it", file=sys.stderr)
    # Imported only here, so that exported models run without PyTorch.
    if threads is not None:
        import_module("torch").set_num_threads(thread_limit(threads))
    return import_module("latentmotion.gpu.backend")
