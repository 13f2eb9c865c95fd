"""A study as one self-contained HTML page: no server, no request, no name of a model.

Its script is the viewer's, which knows a study by what the page carries.
"""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

from latentmotion.storage.files import atomic_file
from latentmotion.study.design import Study, asked
from latentmotion.viewer.page import json_in_html, payload, script


def study_html(study: Study) -> str:
    """Returns the page."""
    key = study.key
    motions = [
        replace(motion, caption=row.prompt, metadata={})
        for row, sides in zip(key.pairs, study.motions, strict=True)
        for motion in sides
    ]
    pairs = [
        {"id": row.id, "prompt": row.prompt, "questions": asked(row.prompt, list(key.questions))}
        for row in key.pairs
    ]
    carried = {"study": key.study, "questions": key.questions, "pairs": pairs, **payload(motions)}
    fields = {"study": json_in_html(carried), "script": script()}
    return re.sub(r"\{\{(\w+)\}\}", lambda field: fields[field[1]], _template())


def write_study_page(path: str | Path, study: Study) -> None:
    """Writes `study_html` to a file, whole or not at all."""
    page = study_html(study)
    with atomic_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _template() -> str:
    template = resources.files("latentmotion.study").joinpath("template.html")
    return template.read_text(encoding="utf-8")
