"""Identifiers use the words of the field (docs/glossary.md): old private words stand in no room."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "latentmotion"

# Words that mean nothing else in any room.
ANYWHERE = (
    r"Leaps?|LeapTimes|LeapBatch|LeapSource|LeapEmbedding|NoLeap|leap_loss|StepByStep|"
    r"SentenceReading|Ways|AlongWays|WAYS_FILE|Lessons|Steering|steering_of|PromptTable|"
    r"FeatureMemory|LatentMemory|FrameMemory|remembered_\w+|WAY_BACK|way_back|cheaper\w*|"
    r"GuidanceAsInput|training_place|sees_padding|SeePadding|SeparatePlaces|joints_knee|walk_file"
)

# Words that other rooms need for legs, animals and gaits.
IN_ROOMS = (
    r"leaps?|ways|walk|knee|divergence|slope|prediction|Prediction|answer|Answer|steering|"
    r"lessons|Guide|Place|leads|places"
)

ROOMS = ("diffusion", "condition", "model", "networks", "training")


def identifiers(path: Path) -> Iterator[tuple[int, str]]:
    """Yields the names that a file defines or uses, with their lines."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                yield node.lineno, name
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield node.lineno, name
            case ast.keyword(arg=str(name)) | ast.alias(name=name):
                yield node.lineno, name


@pytest.mark.parametrize(
    "room", sorted(p.name for p in SOURCE.iterdir() if (p / "__init__.py").exists())
)
def test_no_old_word_in_a_name(room: str) -> None:
    words = re.compile(f"_*(?:{ANYWHERE}|{IN_ROOMS})" if room in ROOMS else f"_*(?:{ANYWHERE})")
    found = [
        f"{path.relative_to(SOURCE)}:{line} {name}"
        for path in sorted((SOURCE / room).rglob("*.py"))
        if path.parent != SOURCE / "training" / "captioning"  # it writes of legs and gaits
        for line, name in identifiers(path)
        if words.fullmatch(name)
    ]
    assert not found, "old words, see docs/glossary.md: " + ", ".join(found)
