"""All tables of lab/diary/performance.md, in some ten minutes, and the page filled.

    python -m benchmarks runs/benchmarks --models starter fast --int8 fast-int8=FOLDER
    python -m benchmarks runs/benchmarks … --page lab/diary/performance.md

What a program prints becomes a file of its name in the folder. With --page the parts of a document
between <!-- NAME --> and <!-- end of NAME --> are replaced by these files.
"""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

_PART = re.compile(r"<!-- (\w+) -->\n.*?<!-- end of \1 -->", re.DOTALL)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the programs, one after another, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the tables go")
    parser.add_argument("--models", nargs="*", default=["starter"])
    parser.add_argument("--int8", nargs="*", default=[])
    parser.add_argument("--captions", help="of held-out sentences, for the text encoder")
    parser.add_argument("--only", nargs="*", help="names of some of the tables")
    parser.add_argument("--page", type=Path, help="document to fill")
    options = parser.parse_args(arguments)
    programs = _programs(options)
    names = options.only or list(programs)
    if odd := set(names) - set(programs):
        parser.error(f"--only {min(odd)}: expected some of {', '.join(programs)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (options.folder / f"{name}.md").write_text(_printed(programs[name]), encoding="utf-8")
    if options.page:
        fill(options.page, options.folder)


def fill(page: Path, folder: Path) -> None:
    """Replaces the marked parts of a document by the tables of a folder."""

    def part(found: re.Match[str]) -> str:
        source = folder / f"{found[1]}.md"
        if not source.is_file():
            return found[0]
        text = source.read_text(encoding="utf-8").strip()
        return f"<!-- {found[1]} -->\n{text}\n<!-- end of {found[1]} -->"

    page.write_text(_PART.sub(part, page.read_text(encoding="utf-8")), encoding="utf-8")


def _programs(options: argparse.Namespace) -> dict[str, list[str]]:
    models = ["--models", *options.models, *(["--int8", *options.int8] if options.int8 else [])]
    captions = ["--captions", options.captions] if options.captions else []
    last, speed = options.models[-1], ["generation.speed", *models, "--processes", "0"]
    return {
        "one": [*speed, "--batches", "1", "--turns", "7"],
        "one_thread": [*speed, "--batches", "1", "--turns", "5", "--threads", "1"],
        "many": [*speed, "--batches", "32", "--turns", "2"],
        "files": ["generation.files", "--model", last],
        "cold": ["generation.cold_start", *models, "--turns", "3"],
        "growth": ["generation.growth", *models, "--engines", "openvino", "--turns", "3"],
        "training": ["training.speed", "--first", "16", "--turns", "3"],
        "text": ["generation.text_encoder", *captions],
        "pictures": ["generation.render", "--turns", "1"],
    }


def _printed(words: Sequence[str]) -> str:
    print(f"{shlex.join(words)} …", end=" ", file=sys.stderr, flush=True)
    start, command = (
        time.perf_counter(),
        [sys.executable, "-m", f"benchmarks.{words[0]}", *words[1:]],
    )
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    print(f"{time.perf_counter() - start:.0f} s", file=sys.stderr)
    return f"{printed.strip()}\n"


if __name__ == "__main__":
    main()
