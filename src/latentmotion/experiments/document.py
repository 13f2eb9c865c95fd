"""Puts tables that were run into a document, between the lines that name them.

<!-- table vae -->
(replaced by the page of the table `vae`)
<!-- end of table vae -->
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.experiments.tables import TABLES
from latentmotion.storage.files import atomic_file

_PART = re.compile(r"<!-- table (\w+) -->\n(.*?)<!-- end of table \1 -->", re.DOTALL)


def fill(document: Path, results: Path) -> list[str]:
    """Replaces the parts of a document by tables; their data and plots go beside it.

    Args:
        document: Markdown with marked parts.
        results: Output folder of `latentmotion experiment run`.

    Returns:
        The names of the tables that were put in.

    Raises:
        InputError: The document has no marked part, names an unknown table, or cannot be read.
    """
    try:
        text = document.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read {document}: {error.strerror}") from error
    names = [match.group(1) for match in _PART.finditer(text)]
    unknown = [name for name in names if name not in TABLES]
    if unknown or not names:
        found = f"names the unknown table {unknown[0]!r}" if unknown else "has no marked part"
        raise InputError(f"{document} {found}; a part is <!-- table vae --> … <!-- end of … -->")
    run = [name for name in names if (results / f"{name}.md").is_file()]
    beside = document.parent / document.stem
    beside.mkdir(exist_ok=True)
    filled = _PART.sub(lambda part: _filled(part, run, results, beside), text)
    with atomic_file(document) as temporary:
        temporary.write_text(filled, encoding="utf-8")
    return run


def _filled(part: re.Match[str], run: list[str], results: Path, beside: Path) -> str:
    name = part.group(1)
    if name not in run:
        return part.group(0)
    for ending in (".json", ".png"):
        source = results / f"{name}{ending}"
        if source.is_file():
            shutil.copyfile(source, beside / source.name)
    page = (results / f"{name}.md").read_text(encoding="utf-8")
    page = page.replace(f"]({name}.png)", f"]({beside.name}/{name}.png)")
    return f"<!-- table {name} -->\n{page}<!-- end of table {name} -->"
