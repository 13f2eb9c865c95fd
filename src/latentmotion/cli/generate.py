"""`latentmotion generate`: sentences in, files out."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.files import check_writable
from latentmotion.generator import MotionGenerator
from latentmotion.motion import Motion
from latentmotion.runtime.session import Runtime


@dataclass(frozen=True)
class Generate:
    """Turn sentences into motion files.

    Example: latentmotion generate "a person walks forward and kicks" -o walk.bvh walk.html
    """

    captions: Positional[tuple[str, ...]] = ()
    """What the person does; several sentences make several motions."""
    file: Annotated[Path | None, arg(aliases=["-f"])] = None
    """Text file with one sentence per line, in place of sentences."""
    seconds: float = 4.0
    """Length of each motion."""
    count: int = 1
    """Motions per sentence."""
    seed: int = 0
    """The first motion's seed; the next ones count up. The same seed gives the same motion."""
    output: Annotated[tuple[Path, ...], arg(aliases=["-o"])] = ()
    """Files to write, the ending picks the format: .bvh .glb .npz .html .gif .mp4 .png.
    Without it a page, motion.html, is written."""
    model: str = "starter"
    """Name or folder of the model."""
    steps: int | None = None
    """Sampling steps; by default the model's own."""
    guidance: float | None = None
    """How strongly the sentence steers; by default the model's own."""
    runtime: Runtime = "auto"
    """Engine of the networks; auto takes OpenVINO where it is installed."""
    threads: int | None = None
    """Most threads the engine may use; by default all cores."""
    json: bool = False
    """Print one JSON object for programs instead of text."""

    def run(self) -> None:
        """Generates and writes.

        Raises:
            InputError: A sentence, a number, an ending or a folder cannot be used.
        """
        captions = self._sentences()
        outputs = self.output or (_free_name(Path("motion.html")),)
        for path in outputs:
            formats.check_ending(path)
            check_writable(path)
        motions = self._motions(captions)
        written = [file for path in outputs for file in formats.save(path, motions)]
        print(json.dumps(_report(motions, written)) if self.json else _text(written))

    def _sentences(self) -> list[str]:
        if self.file is not None and self.captions:
            raise InputError("give either sentences or --file, not both")
        sentences = list(self.captions) if self.file is None else _lines(self.file)
        if not sentences:
            raise InputError('no sentence given; try: latentmotion generate "a person walks"')
        if self.count < 1:
            raise InputError(f"--count {self.count}: expected 1 or more")
        return [sentence for sentence in sentences for _ in range(self.count)]

    def _motions(self, captions: list[str]) -> list[Motion]:
        generator = MotionGenerator.load(self.model, self.runtime, self.threads)
        seeds = range(self.seed, self.seed + len(captions))
        return generator.batch(captions, self.seconds, seeds, self.steps, self.guidance)


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read sentences from {path}: {error}") from error
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines:
        raise InputError(f"{path} holds no sentence; expected one per line")
    return lines


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
