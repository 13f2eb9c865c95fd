"""Runs an experiment of directing and prints its page; nothing is trained.

    python -m benchmarks.directing goals --data DATA --model fast -o results

Writes OUTPUT/NAME.md and OUTPUT/NAME.json.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.directing.bench import Bench, write_results
from benchmarks.directing.fits import fit_rows
from benchmarks.directing.goals import goal_rows
from benchmarks.directing.keep import keep_rows
from benchmarks.directing.sentences import length_rows, search_rows
from benchmarks.directing.sequences import loop_rows, stream_rows, timeline_rows
from latentmotion import Dataset, MotionPipeline
from latentmotion.ranking.scorer import shipped_scorer

# Title and function of each experiment, by name.
EXPERIMENTS = {
    "goals": ("goals of joints and paths", goal_rows),
    "keep": ("frames that are kept", keep_rows),
    "timelines": ("several prompts in one motion", timeline_rows),
    "stream": ("minutes of one motion", stream_rows),
    "loops": ("seamless cycles", loop_rows),
    "fit": ("noisy and missing joints", fit_rows),
    "length": ("seconds predicted from the sentence", length_rows),
    "search": ("clips found by a sentence", search_rows),
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", choices=EXPERIMENTS)
    parser.add_argument("--data", type=Path, required=True, help="prepared, with a test split")
    parser.add_argument("--model", default="fast")
    parser.add_argument("--count", type=int, default=40, help="clips of a row, 2 or more")
    parser.add_argument("--seeds", type=int, default=3, help="motions of each clip")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    if options.count < 2 or options.seeds < 1:
        parser.error("expected --count of 2 or more and --seeds of 1 or more")
    title, measure = EXPERIMENTS[options.name]
    generate = MotionPipeline.from_pretrained(options.model, threads=1)
    data = Dataset.load(options.data)
    bench = Bench(generate, data, shipped_scorer(), options.count, options.seeds)
    page = write_results(options.name, title, measure(bench), bench, options.output)
    print(page.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
