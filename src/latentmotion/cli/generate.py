"""`latentmotion generate`: prompts in, files out."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cli.loading import computing_options, load_generator, load_prior
from latentmotion.cli.options import (
    AUTO,
    Body,
    ComputePrecision,
    Device,
    Guidance,
    LaunchMode,
    OptionalTextEncoder,
    Outputs,
    PrintJson,
    RuntimeChoice,
    SamplerChoice,
    Steps,
    Threads,
)
from latentmotion.errors import InputError
from latentmotion.kinematics.animation import check_fps
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.folder import DEFAULT, find_model
from latentmotion.motion import Motion
from latentmotion.representation.smpl import SmplRepresentation, representation_of
from latentmotion.runtime.computing import Computing
from latentmotion.storage.cache_folder import cache_folder
from latentmotion.storage.files import check_writable, read_lines

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
    seed: int = 0
    """Seed of the first motion; later motions count up from it. The same seed gives the same
    motion."""
    output: Annotated[Outputs, arg(help=_OUTPUT)] = ()
    model: str = DEFAULT
    """Name or folder of the model."""
    prior: bool = False
    """Decode random latents of the model's VAE, without prompt and diffusion."""
    steps: Steps = None
    guidance: Guidance = None
    sampler: SamplerChoice = None
    runtime: RuntimeChoice = "auto"
    threads: Threads = None
    cache: bool = True
    """Cache the text encoder's output in the user's cache folder, or in the folder that the
    environment variable LATENTMOTION_CACHE names (`off` for none)."""
    text_encoder: OptionalTextEncoder = None
    device: Device = AUTO
    precision: ComputePrecision = "float32"
    launch: LaunchMode = "eager"
    body: Body = None
    clean: bool = True
    """Clean up the motion: hold standing feet, put the figure on the floor, remove jitter
    (docs/guide/cleanup.md)."""
    fps: float | None = None
    """Frames per second of the files, e.g. 24, 25, 30, 60 or 120; by default the model's own."""
    json: PrintJson = False

    def run(self) -> None:
        """Generates and writes.

        Raises:
            InputError: A prompt, a number, an ending or a folder cannot be used.
            ModelError: The model cannot be loaded.
        """
        prompts = self._given()
        if self.fps is not None:
            check_fps(self.fps)
        outputs = self.output or (_free_name(Path("motion.html")),)
        for path in outputs:
            formats.check_ending(path)
            check_writable(path)
        motions = self._from_prior() if self.prior else self._motions(prompts)
        if self.clean:
            motions = [motion.cleaned() for motion in motions]
        if self.fps is not None:
            motions = [motion.resampled(self.fps) for motion in motions]
        written = [file for path in outputs for file in formats.save(path, motions)]
        print(json.dumps(_report(motions, written)) if self.json else _text(written))

    def _given(self) -> list[str]:
        if self.file is not None and self.prompts:
            raise InputError("give either prompts or --file, not both")
        if self.count < 1:
            raise InputError(f"--count {self.count}: expected 1 or more")
        given = list(self.prompts) if self.file is None else read_lines(self.file, "prompt")
        if not self.prior:
            return _needed(read_card(find_model(self.model)), given)
        if given:
            raise InputError(f"--prior takes no prompt; leave {given[0]!r} out")
        return []

    def _from_prior(self) -> list[Motion]:
        prior = load_prior(self.model, self.runtime, self.threads, self._computing())
        return replace(prior, body=self._body()).batch(
            self.seconds, range(self.seed, self.seed + self.count)
        )

    def _motions(self, prompts: list[str]) -> list[Motion]:
        each = [prompt for prompt in prompts for _ in range(self.count)]
        generator = load_generator(
            self.model,
            self.runtime,
            self.threads,
            self.text_encoder,
            self._computing(),
            cache_folder() if self.cache else None,
        )
        seeds = range(self.seed, self.seed + len(each))
        generator = replace(generator, body=self._body())
        return generator.batch(each, self.seconds, seeds, self.steps, self.guidance, self.sampler)

    def _computing(self) -> Computing:
        return computing_options(self.device, self.precision, self.launch)

    def _body(self) -> SmplRepresentation | None:
        return representation_of(load_smpl(self.body)) if self.body else None


def _needed(card: ModelCard, given: list[str]) -> list[str]:
    """Returns the prompts, of which an unconditional model needs an empty one."""
    if given or not card.condition.prompted:
        return given or [""]
    raise card.condition.no_prompt(card.name)


def _free_name(path: Path) -> Path:
    """Returns `path`, or with a number where a file of that name exists: nothing is lost."""
    names = [path, *(path.with_stem(f"{path.stem}-{n}") for n in range(2, 1000))]
    return next((name for name in names if not name.exists()), path)


def _report(motions: list[Motion], written: list[Path]) -> dict[str, object]:
    details = [
        {"caption": m.caption, "seconds": m.seconds, "frames": len(m), "fps": m.fps, **m.metadata}
        for m in motions
    ]
    return {"files": [str(path.absolute()) for path in written], "motions": details}


def _text(written: list[Path]) -> str:
    return "\n".join(f"wrote {path}" for path in written)
