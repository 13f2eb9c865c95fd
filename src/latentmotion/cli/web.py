"""`latentmotion web`: a static site on which a model generates in the visitor's browser."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.cli import options
from latentmotion.errors import MissingExtraError
from latentmotion.model.card import DEFAULT, find_model
from latentmotion.storage.files import check_replaceable
from latentmotion.viewer import site
from latentmotion.viewer.pyodide import pyodide_files


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
    pyodide: Path | None = None
    """Folder of Pyodide (npm install pyodide@314.0.7) and NumPy's wheel for it, from Pyodide's
    release: with it the page cleans motions up and writes CSV and HTML too."""

    def run(self) -> None:
        """Writes the site and prints its size.

        Raises:
            InputError: A file is missing, or there is something else at the output.
            MissingExtraError: The model has to be exported first, which needs the extra `train`.
        """
        check_replaceable(self.output, "service.js")
        if (Path(self.model) / site.MANIFEST_FILE).is_file():
            site.write_site(self.output, Path(self.model), self.runtime, self.pyodide)
        else:
            self._export_and_write()
        size = sum(file.stat().st_size for file in self.output.rglob("*") if file.is_file()) / 1e6
        print(f"wrote {self.output} ({size:.1f} MB)")
        if self.pyodide is None:
            print("clean-up and CSV and HTML files are left out; --pyodide FOLDER adds them")

    def _export_and_write(self) -> None:
        site.runtime_file(self.runtime)
        if self.pyodide is not None:
            pyodide_files(self.pyodide)
        try:
            from latentmotion.export.web import export_web
        except ModuleNotFoundError as error:
            raise MissingExtraError("exporting a model", str(error.name), "train") from error
        with tempfile.TemporaryDirectory() as temporary:
            export_web(find_model(self.model), Path(temporary) / "model")
            site.write_site(self.output, Path(temporary) / "model", self.runtime, self.pyodide)
