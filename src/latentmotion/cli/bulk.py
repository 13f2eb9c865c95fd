"""`latentmotion bulk`: motions of many prompts, by any number of processes and machines."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.bulk import ROWS, BulkGeneration, Format, work_of
from latentmotion.cli import loading, options
from latentmotion.errors import InputError
from latentmotion.formats import EngineName
from latentmotion.model.card import DEFAULT
from latentmotion.storage import shards


@dataclass(frozen=True)
class Bulk(options.SamplingOptions, options.ComputingOptions):
    """Turn a file of prompts into many motions, shard by shard.

    A killed run goes on with the same command; finished shards are skipped. The files are the same,
    byte by byte, for any number of processes.

    Examples:
        latentmotion bulk prompts.txt -o motions
        latentmotion bulk prompts.txt -o clips --format glb --preset unreal --rows 32
        latentmotion bulk prompts.csv -o shared/motions --shard 3/16
    """

    prompts: Annotated[Positional[Path | None], arg(metavar="PROMPTS")] = None
    """Text file with one prompt per line, or CSV with the column prompt and, if wanted, seconds and
    seed."""
    output: Annotated[Path, arg(aliases=["-o"])] = Path("motions")
    """Folder to write."""
    shard: str | None = None
    """Make only a part of the shards, such as 3/16: the third of sixteen processes."""
    check: bool = False
    """Make nothing: compare the files of a finished run with its manifest, and its settings with
    the prompts and options that are given, if any."""
    format: Format = "safetensors"
    """Format of the shards; glb, bvh or fbx: a file for each motion, and a table of them."""
    preset: EngineName | None = None
    """Names of bones of these files, as of `generate --preset`."""
    fps: float | None = None
    """Frames per second of these files; by default the model's own."""
    rows: int = ROWS
    """Rows of a shard. Motions of one shard go through the networks together, so another number
    changes their last bits."""
    seconds: float | None = None
    """Length of motions whose row has none; by default the model predicts it."""
    seed: int = 0
    """Seed of the first row; later rows count up from it, unless they have their own."""
    model: str = DEFAULT
    """Name or folder of the model."""
    runtime: options.RuntimeChoice = "auto"
    threads: int = 1
    """Threads of a process; several processes with one each are faster."""
    clean: bool = True
    """Clean up the motions (docs/guide/cleanup.md)."""
    exact_count: bool = True
    """As part of the clean-up, make motions whose length nobody gave do an act as often as their
    sentence says."""
    exact_turn: bool = True
    """As part of the clean-up, make motions turn by the degrees that their sentence names."""

    def run(self) -> None:
        """Makes the shards, or checks them.

        Raises:
            DataError: A file differs from the manifest, or is missing.
            InputError: The prompts, a number or the folder cannot be used.
            ModelError: The model cannot be loaded.
        """
        if self.check:
            options.refuse_unused(self, "--check makes nothing", "shard")
        if self.check and self.prompts is None:
            others = {field.name for field in fields(self)} - {"output", "check"}
            options.refuse_unused(self, "--check without prompts compares files alone", *others)
            self._print_summary(shards.check(shards.folder_at(self.output)))
            return
        if self.prompts is None:
            raise InputError("no prompts given; name a file: latentmotion bulk prompts.txt")
        share = options.share_of(self.shard)
        opening = (self.runtime, self.threads, self.text_encoder, self.execution)
        pipeline = loading.load_generator(self.model, *opening)
        generation = BulkGeneration(options=opening, **options.values_for(BulkGeneration, self))
        work = work_of(generation, pipeline, self.prompts, self.seed, self.rows)
        if self.check:
            folder = shards.folder_at(self.output)
            manifest = shards.check(folder)
            shards.start(work.run, folder)  # raises an error where another run was finished
            self._print_summary(manifest)
            return
        folder = shards.folder_at(self.output, create=True)

        def report(record: shards.Record) -> None:
            print(f"{record.name}: {record.items} motions", file=sys.stderr, flush=True)
            for wrong in record.wrong:
                print(f"{self.prompts}:{wrong.line}: {wrong.problem}; left out", file=sys.stderr)

        manifest = shards.make(work, folder, share, report)
        if manifest:
            self._print_summary(manifest)
        else:
            print(f"{self.output}: shard {self.shard} is finished, others are not")

    def _print_summary(self, manifest: shards.ShardManifest) -> None:
        motions = sum(record.items for record in manifest.shards)
        wrong = sum(len(record.wrong) for record in manifest.shards)
        files = [file for shard in manifest.shards for file in (shard, *shard.files)]
        size = sum(file.size for file in files) / 1e6
        left = f", {wrong} rows left out" if wrong else ""
        what = "as their manifest says" if self.check else "all finished"
        print(f"{self.output}: {motions} motions{left}; files {len(files)}, {size:.1f} MB, {what}")
