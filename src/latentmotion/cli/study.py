"""`latentmotion study make` and `latentmotion study report`: people judge, blind."""

from __future__ import annotations

import json
import secrets
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from latentmotion.errors import InputError
from latentmotion.storage.configuration import to_json, write_json
from latentmotion.storage.files import check_writable

if TYPE_CHECKING:
    from latentmotion.study.design import Pair


@dataclass(frozen=True)
class MakeStudy:
    """Make one page on which people compare two models, without knowing which is which.

    A and B are models by name or folder, or folders of .npz motions whose captions are the prompts.
    The page is a single file to send to raters; the key beside it stays with you.
    """

    a: Annotated[Positional[str], arg(metavar="A")]
    """Model A."""
    b: Annotated[Positional[str], arg(metavar="B")]
    """Model B."""
    prompts: Path
    """Text file with one sentence per line."""
    output: Annotated[Path, arg(aliases=["-o"])] = Path("study.html")
    """The page; its key is written beside it with the ending .key.json."""
    seconds: float = 4.0
    """Length of generated motions."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of generated motions, or so many takes of saved ones: a pair per prompt and seed."""
    order_seed: int | None = None
    """Seed of order and sides; drawn and recorded in the key if not given."""

    def run(self) -> None:
        """Makes the page and the key."""
        from latentmotion.study.design import design
        from latentmotion.study.page import write_study_page
        from latentmotion.study.sources import describe

        self._check()
        pairs = self._pairs()
        seed = secrets.randbits(32) if self.order_seed is None else self.order_seed
        study = design(pairs, describe(self.a), describe(self.b), seed)
        write_study_page(self.output, study)
        write_json(self.output.with_suffix(".key.json"), study.key)
        number = "1 pair" if len(pairs) == 1 else f"{len(pairs)} pairs"
        print(f"wrote {self.output} ({number}), for raters")
        print(f"wrote {self.output.with_suffix('.key.json')}, for you alone")

    def _check(self) -> None:
        if self.output.suffix != ".html":
            raise InputError(f"{self.output}: expected a name that ends with .html")
        check_writable(self.output)
        if self.order_seed is not None and self.order_seed < 0:
            raise InputError(f"--order-seed {self.order_seed}: expected a number from 0 up")

    def _pairs(self) -> list[Pair]:
        from latentmotion.cli.loading import load_generator
        from latentmotion.study.design import Pair
        from latentmotion.study.sources import Wanted, check_lengths, motions_of, read_prompts

        wanted = Wanted(read_prompts(self.prompts), self.seeds, self.seconds)
        a, b = (motions_of(source, wanted, load_generator) for source in (self.a, self.b))
        both = list(zip(a, b, strict=True))
        for warning in check_lengths(both):
            print(f"warning: {warning}", file=sys.stderr)
        rows = zip(wanted.rows(), both, strict=True)
        return [Pair(prompt, seed, a, b) for (prompt, seed), (a, b) in rows]


@dataclass(frozen=True)
class ReportStudy:
    """Say what raters prefer, from the files that their browsers downloaded."""

    answers: Annotated[Positional[tuple[Path, ...]], arg(metavar="ANSWERS")]
    """The files; of several by one rater the latest counts."""
    key: Path
    """The key that was written with the page."""
    json: bool = False
    """Print one JSON object for programs instead of text."""

    def run(self) -> None:
        """Reports.

        Raises:
            InputError: There is no file.
        """
        from latentmotion.study.answers import read_answers, read_key, votes_of
        from latentmotion.study.report import report

        if not self.answers:
            raise InputError("no answers given; pass the files that raters sent, e.g. *.json")
        key = read_key(self.key)
        others = [path for path in self.answers if path.resolve() != self.key.resolve()]
        found = report(votes_of(read_answers(others, key), key), key)
        print(json.dumps(to_json(found), indent=1) if self.json else found.markdown())
