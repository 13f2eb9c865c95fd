"""`latentmotion study make`, `study report` and `web`: pages for raters and for visitors."""

from __future__ import annotations

import json
import secrets
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.cli import options
from latentmotion.errors import InputError, MissingExtraError
from latentmotion.model.card import DEFAULT, find_model
from latentmotion.storage.configuration import to_json, write_json
from latentmotion.storage.files import check_replaceable, check_writable, read_lines, write_file
from latentmotion.viewer import site


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
    output: options.Output = Path("study.html")
    """Page to write; its key is written beside it with the extension .key.json."""
    seconds: float = 4.0
    """Length of generated motions."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of generated motions, or the number of takes of saved ones; one pair per prompt and
    seed."""
    order_seed: int | None = None
    """Seed of order and sides; by default random. It is recorded in the key."""

    def run(self) -> None:
        """Makes the page and the key."""
        from latentmotion.cli.loading import load_generator
        from latentmotion.study import design

        if self.output.suffix != ".html":
            raise InputError(f"{self.output}: expected a name that ends with .html")
        check_writable(self.output)
        if self.order_seed is not None and self.order_seed < 0:
            raise InputError(f"--order-seed {self.order_seed}: expected a number from 0 up")
        sentences = tuple(dict.fromkeys(read_lines(self.prompts, "sentence")))
        plan = design.StudyPlan(sentences, self.seeds, self.seconds)
        a, b = (design.motions_of(source, plan, load_generator) for source in (self.a, self.b))
        both = list(zip(a, b, strict=True))
        for warning in design.check_lengths(both):
            print(f"warning: {warning}", file=sys.stderr)
        rows = zip(plan.rows(), both, strict=True)
        pairs = [design.Pair(prompt, seed, a, b) for (prompt, seed), (a, b) in rows]
        seed = secrets.randbits(32) if self.order_seed is None else self.order_seed
        study = design.design(pairs, design.describe(self.a), design.describe(self.b), seed)
        write_file(self.output, design.study_html(study))
        write_json(self.output.with_suffix(".key.json"), study.key)
        number = "1 pair" if len(pairs) == 1 else f"{len(pairs)} pairs"
        print(f"wrote {self.output} ({number}), for raters")
        print(f"wrote {self.output.with_suffix('.key.json')}, for you alone")


@dataclass(frozen=True)
class ReportStudy:
    """Report what raters prefer, from the files that their browsers saved."""

    answers: Annotated[Positional[tuple[Path, ...]], arg(metavar="ANSWERS")]
    """Files that raters sent; the latest of each rater counts."""
    key: Path
    """Key that was written with the page."""
    json: options.PrintJson = False

    def run(self) -> None:
        """Reports.

        Raises:
            InputError: There is no file.
        """
        from latentmotion.study import report

        if not self.answers:
            raise InputError("no answers given; pass the files that raters sent, e.g. *.json")
        key = report.read_key(self.key)
        others = [path for path in self.answers if path.resolve() != self.key.resolve()]
        votes = report.votes_of(report.read_answers(others, key), key)
        result = report.report(votes, key)
        print(json.dumps(to_json(result), indent=1) if self.json else result.markdown())


@dataclass(frozen=True)
class Web:
    """Write a static site that turns sentences into motion in the visitor's browser.

    Any static host serves it; to try it: python -m http.server --directory site
    Example: latentmotion web -o site --runtime node_modules/onnxruntime-web/dist
    """

    model: Annotated[Positional[str], arg(metavar="MODEL")] = DEFAULT
    """Name or folder of a few-step model of sentences, or a folder that `latentmotion export --web`
    wrote, which needs no PyTorch."""
    output: options.Output = Path("site")
    """Folder to write."""
    runtime: Path = Path("node_modules/onnxruntime-web/dist")
    """Folder with ONNX Runtime's WebAssembly: npm install onnxruntime-web@1.30.0"""

    def run(self) -> None:
        """Writes the site and prints its size.

        Raises:
            InputError: A file is missing, or there is something else at the output.
            MissingExtraError: The model has to be exported first, which needs the extra `train`.
        """
        check_replaceable(self.output, "service.js")
        if (Path(self.model) / site.MANIFEST_FILE).is_file():
            site.write_site(self.output, Path(self.model), self.runtime)
        else:
            site.runtime_file(self.runtime)
            try:
                from latentmotion.export.web import export_web
            except ModuleNotFoundError as error:
                raise MissingExtraError("exporting a model", str(error.name), "train") from error
            with tempfile.TemporaryDirectory() as temporary:
                exported = Path(temporary) / "model"
                export_web(find_model(self.model), exported)
                site.write_site(self.output, exported, self.runtime)
        size = sum(file.stat().st_size for file in self.output.rglob("*") if file.is_file()) / 1e6
        print(f"wrote {self.output} ({size:.1f} MB)")
