"""Motions in bulk: prompts of a text file or CSV; shards, and what each of them holds.

A shard is a fixed run of rows of the prompts' file, generated together, so its bytes do not depend
on how many processes share the work. They do on its number of rows: the last bits of a motion
depend on those that go through the networks with it.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from safetensors.numpy import save

from latentmotion import __version__
from latentmotion.cleanup import CleanUp
from latentmotion.diffusion.condition import SentenceCondition
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.engine import request as requests
from latentmotion.engine.encoder import MemoryCachedTextEncoder
from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats import EngineName, fbx
from latentmotion.formats.content import encoded
from latentmotion.formats.engines import for_engine
from latentmotion.kinematics.skeleton import check_fps
from latentmotion.model.card import DEFAULT, find_model
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage import limits, reading, shards
from latentmotion.storage.files import sha256

COLUMNS = ("prompt", "seconds", "seed")  # Columns of a table that are read; the first is needed.


@dataclass(frozen=True)
class PromptRow:
    """A requested motion."""

    line: int  # Its line in the file, counted from 1.
    prompt: str  # A sentence, a label or nothing.
    seed: int  # Seed of its noise.
    seconds: float | None = None  # Its length, if it is given.
    problem: str = ""  # Its error, if any.


def read_rows(path: Path, seed: int = 0) -> list[PromptRow]:
    """Reads a file of prompts; wrong numbers are problems of their rows, not errors.

    Args:
        path: A text file with a prompt in every line, or `.csv` with the columns
            prompt and, if wanted, seconds and seed.
        seed: Seed of the first row; later rows count up from it, unless they have their own.

    Raises:
        FileFormatError: The file cannot be read, lacks the column or has too many rows.
        InputError: It holds no row.
    """
    if path.suffix.lower() == ".csv":
        table = reading.read_table(path, COLUMNS[:1])
    else:
        lines = io.StringIO(reading.read_text(path), newline=None)
        table = [(number, {"prompt": line}) for number, line in enumerate(lines, 1)]
    if not table:
        raise InputError(f"{path} holds no prompt; expected one per line")
    if len(table) > limits.MOST_PROMPTS:
        problem = f"{len(table):,} rows, at most {limits.MOST_PROMPTS:,} are read; split the file"
        raise FileFormatError(path, problem)
    rows = []
    for number, (line, cells) in enumerate(table, seed):
        prompt, problem, seconds = cells["prompt"].strip(), "", None
        length, seed_text = cells.get("seconds"), cells.get("seed")
        if len(prompt) > limits.MOST_PROMPT:
            problem = f"{len(prompt):,} characters, expected at most {limits.MOST_PROMPT:,}"
        try:
            seconds = float(length) if length else None
            if seconds is not None and not math.isfinite(seconds):
                raise ValueError
        except ValueError:
            problem, seconds = f"{length!r:.80} seconds: expected a number", None
        try:
            number = int(seed_text) if seed_text else number
            if not 0 <= number < 2**63:
                raise ValueError
        except ValueError:
            problem = f"seed {seed_text!r:.80}: expected a whole number from 0 up, below 2^63"
        rows.append(PromptRow(line, prompt[: limits.MOST_PROMPT], number, seconds, problem))
    return rows


# Format of the shards; or of the motions, a file each, with a table of them for each shard.
Format = Literal["safetensors", "glb", "bvh", "fbx"]

ONE_EACH = ("glb", "bvh", "fbx")  # Formats of a file for each motion.

# Characters of the name of such a file at most.
_LONGEST_NAME = 60

ROWS = 512  # Rows of a shard: some 10 MB, and some 10 s of one core.

_MODEL_FILES = ("*.json", "*.onnx", "*.safetensors")


@dataclass(frozen=True)
class BulkGeneration:
    """How rows become motions."""

    model: str = DEFAULT  # Name or folder of the model.
    # How it was opened, on which the bytes depend, too: runtime, threads and the like.
    options: tuple[Any, ...] = ()
    # Length of motions whose row has none; by default the model predicts it.
    seconds: float | None = None
    steps: int | None = None  # Sampling steps; by default the model's own.
    guidance: float | None = None  # Guidance scale; by default the model's own.
    sampler: SamplerName | None = None  # Sampler; by default the model's own.
    clean: bool = True  # Whether motions are cleaned up.
    # Whether clean-up makes counts exact, of motions whose length nobody gave.
    exact_count: bool = True
    exact_turn: bool = True  # Whether clean-up makes turns exact.
    format: Format = "safetensors"  # Format of the shards, or of the motions.
    preset: EngineName | None = None  # Names of bones of the motions' files.
    fps: float | None = None  # Frames per second of the motions' files; by default the model's own.

    def frames(self, pipeline: MotionPipeline, rows: Sequence[PromptRow]) -> list[int]:
        """Returns the length of each row's motion: its own, the run's or the predicted one.

        Raises:
            InputError: A length is out of the model's range.
        """
        card, fps = pipeline.card, pipeline.representation.fps
        lengths = [self.seconds if row.seconds is None else row.seconds for row in rows]
        free = [row.prompt for row, seconds in zip(rows, lengths, strict=True) if seconds is None]
        usual = iter(requests.frames_of(card, None, len(free), fps, pipeline.usual_seconds(free)))
        frames = [
            next(usual) if seconds is None else requests.frames_of(card, seconds, 1, fps)[0]
            for seconds in lengths
        ]
        requests.check_frames(card, frames, fps)
        return frames

    def check(self, pipeline: MotionPipeline) -> None:
        """Checks what holds for all rows.

        Raises:
            InputError: The model does not support these settings.
        """
        task = pipeline.card.condition
        sampling = pipeline.card.sampling.but(self.steps, self.guidance, self.sampler)
        prompt = next(iter(task.labels), "a person walks") if task.prompted else ""
        frames = self.frames(pipeline, [PromptRow(0, prompt, 0)])
        request = requests.GenerationRequest((prompt,), tuple(frames), (0,), sampling)
        request.check(pipeline.card, pipeline.representation.fps)

    def problem(self, pipeline: MotionPipeline, row: PromptRow) -> str:
        """Returns what is wrong with a row, or nothing."""
        card = pipeline.card
        try:
            card.condition.check_prompt(row.prompt, card.name)
            if not card.condition.reads_text:  # it tells known labels from others
                pipeline.condition([row.prompt])
            if row.seconds is not None:
                self.frames(pipeline, [row])
        except InputError as error:
            return row.problem or str(error)
        return row.problem

    def motions(self, pipeline: MotionPipeline, rows: Sequence[PromptRow]) -> list[Motion]:
        """Generates the motions of rows without problems, together."""
        if not rows:
            return []
        condition = pipeline.condition
        if isinstance(condition, SentenceCondition):  # lengths and networks read the same ones
            condition = replace(condition, encoder=MemoryCachedTextEncoder(condition.encoder))
            pipeline = replace(pipeline, condition=condition)
        return pipeline.batch(
            [row.prompt for row in rows],
            [self.seconds if row.seconds is None else row.seconds for row in rows],
            [row.seed for row in rows],
            *(self.steps, self.guidance, self.sampler),
            clean_up=CleanUp(self.exact_count, self.exact_turn) if self.clean else None,
        )


def work_of(
    generation: BulkGeneration,
    pipeline: MotionPipeline,
    prompts: Path,
    seed: int = 0,
    rows: int = ROWS,
) -> shards.Work:
    """Returns the shards of a file of prompts.

    Args:
        generation: How rows become motions.
        pipeline: The model.
        prompts: Text file or CSV; see `read_rows`.
        seed: Seed of the first row; later rows count up from it.
        rows: Rows of a shard.

    Raises:
        FileFormatError: The prompts cannot be read.
        InputError: The model does not support the settings, or a number is out of range.
    """
    if rows < 1 or seed < 0:
        raise InputError(f"{rows} rows of a shard, seed {seed}: expected 1 or more, 0 or more")
    if generation.format == "fbx":
        fbx.check_ready()
    one_each = generation.format in ONE_EACH
    if not one_each and (generation.preset or generation.fps is not None):
        raise InputError(f"--preset and --fps are those of files: {', '.join(ONE_EACH)}")
    if generation.fps is not None:
        check_fps(generation.fps)
    every = tuple(read_rows(prompts, seed))
    generation.check(pipeline)
    folder = find_model(generation.model)
    files = sorted(file for pattern in _MODEL_FILES for file in folder.glob(pattern))
    settings = {
        **vars(generation),
        "options": [str(option) for option in generation.options],
        "model": pipeline.card.name,
        "weights": hashlib.sha256("".join(map(sha256, files)).encode()).hexdigest(),
        "seed": seed,
        "rows": rows,
        "prompts": sha256(prompts),
        "version": __version__,
    }
    starts = range(0, len(every), rows)
    tasks = {
        f"motions-{number:05d}.{'csv' if one_each else generation.format}": partial(
            make_shard, generation, pipeline, every[start : start + rows]
        )
        for number, start in enumerate(starts)
    }
    return shards.Work(shards.ShardedRun(settings, len(every), tuple(tasks)), tasks)


def make_shard(
    generation: BulkGeneration, pipeline: MotionPipeline, rows: Sequence[PromptRow]
) -> shards.ShardContent:
    """Generates the motions of a shard."""
    problems = {row.line: generation.problem(pipeline, row) for row in rows}
    good = [row for row in rows if not problems[row.line]]
    motions = generation.motions(pipeline, good)
    card, space = pipeline.card, pipeline.representation
    about = {
        "model": card.name,
        **card.terms(),
        "fps": space.fps,
        "joints": space.skeleton.names,
        "parents": space.skeleton.parents,
    }
    columns = {
        "line": np.array([row.line for row in good], np.int64),
        "seed": np.array([row.seed for row in good], np.int64),
        "frames": np.array([len(motion) for motion in motions], np.int64),
    }
    wrong = tuple(shards.Wrong(line, problem) for line, problem in problems.items() if problem)
    if generation.format in ONE_EACH:
        files, table = {}, io.StringIO(newline="")
        writer = csv.writer(table)
        writer.writerow(["file", "line", "seed", "seconds", "prompt"])
        for row, motion in zip(good, motions, strict=True):
            words = "".join(c if c.isascii() and c.isalnum() else " " for c in row.prompt).split()
            stem = "_".join([f"{row.line:07d}", *words])[:_LONGEST_NAME].rstrip("_")
            name, seconds = f"{stem}.{generation.format}", f"{motion.seconds:g}"
            writer.writerow([name, row.line, row.seed, seconds, row.prompt])
            if generation.fps is not None:
                motion = motion.resampled(generation.fps)
            if generation.preset is not None:
                motion = for_engine(motion, generation.preset)
            files[name], _ = encoded([motion], generation.format)
        return shards.ShardContent(table.getvalue().encode(), len(good), wrong, files)
    none = np.zeros((0, len(space.skeleton), 3), np.float32)
    joints = np.concatenate([none, *(motion.joints for motion in motions)])
    # One entry only, since several are written in any order.
    plain = json.dumps({**about, "prompts": [row.prompt for row in good]}, ensure_ascii=False)
    content = save({"joints": joints, **columns}, {"latentmotion": plain})
    return shards.ShardContent(content, len(good), wrong)
