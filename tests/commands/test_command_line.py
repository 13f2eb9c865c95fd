"""The interface of the command line is frozen: verbs, options, types and defaults."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from difflib import unified_diff
from pathlib import Path

import pytest

from latentmotion.cli import VERBS
from latentmotion.cli.main import main

SNAPSHOT = Path(__file__).parent / "command_line.txt"
UPDATE = "UPDATE_COMMAND_LINE"  # Environment variable by which the snapshot is written anew.

ENTRY = re.compile(r"^│ (?=[^\s─])")
DEFAULT = re.compile(r"\((default: .*|required|optional|repeatable)\)$")


def helped(verb: str) -> str:
    """Returns a help page with lines as long as they need; its boxes depend on the encoding."""
    page = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as stop:
        patch.setenv("COLUMNS", "119")  # wider pages stand in two columns
        patch.setattr(sys, "stdout", page)
        main([*verb.split(), "--help"])
    assert not stop.value.code
    page.seek(0)
    return page.read()


def interface(text: str) -> list[str]:
    """Returns each argument and option of a help page: its names, its type and its default."""
    found: list[str] = []
    for line in text.splitlines():
        if ENTRY.match(line):
            found.append(line.strip("│ "))
        elif line.startswith("│  "):
            found[-1] += "  " + line.strip("│ ")
    rows = []
    for entry in found:
        name, gap, told = entry.partition("  ")
        default = DEFAULT.search(" ".join(told.split()))
        if gap and default and not name.startswith("-h,"):
            rows.append(f"  {name}  ({default[1]})")
    return rows


def test_the_interface_is_as_it_was() -> None:
    pages = {verb: interface(helped(verb)) for verb in VERBS}
    found = "\n".join(line for verb in VERBS for line in (verb, *pages[verb])) + "\n"
    if os.environ.get(UPDATE):
        SNAPSHOT.write_text(found, encoding="utf-8")
    expected = SNAPSHOT.read_text(encoding="utf-8")
    difference = "\n".join(unified_diff(expected.splitlines(), found.splitlines(), lineterm=""))
    assert found == expected, (
        f"the command line differs from {SNAPSHOT.name}:\n{difference}\nIf the change is wanted, "
        f"write the snapshot anew: {UPDATE}=1 pytest {Path(__file__).name}"
    )


def frozen() -> dict[str, list[str]]:
    """Returns the rows of every verb in the snapshot."""
    rows: dict[str, list[str]] = {}
    verb = ""
    for line in SNAPSHOT.read_text(encoding="utf-8").splitlines():
        if line.startswith(" "):
            rows[verb].append(line.strip())
        else:
            rows[verb := line] = []
    return rows


def options_of(verb: str) -> dict[str, str]:
    """Returns a verb's rows in the snapshot by the option's long name."""
    found = ((re.search(r"--[\w-]+", row), row) for row in frozen()[verb])
    return {match[0]: row for match, row in found if match}


@pytest.mark.parametrize("verb", VERBS)
def test_options_of_one_name_look_the_same_in_every_verb(verb: str) -> None:
    rows = options_of(verb)
    synonyms = {"--out", "--batch"} | ({"--folder"} if verb != "mcp" else set())  # it reads, too
    assert not synonyms & rows.keys()
    for name, short in (("--output", "-o"), ("--data", "-d"), ("--evaluator", "-e")):
        assert name not in rows or rows[name].startswith(f"{short} ")
    assert rows.get("--device", "(default: auto)").endswith("(default: auto)")
    seed = "--seed INT  (optional)" if verb == "generate" else "--seed INT  (default: 0)"
    assert rows.get("--seed", seed) == seed  # a scene has a seed of its own


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("data merge a --outt b", "unknown option '--outt'; did you mean '--output'?"),
        ("train vae -d no -o out --stps 3", "unknown option '--stps'; did you mean '--steps'?"),
        ("train vae -d no -o out --steps 0", "training with steps 0: expected 1 or more"),
        ("train vae -d no -o out --steps 1e3", "--steps '1e3': expected a whole number"),
        ("train vae -d no -o out --preset fats", "unknown preset 'fats'; did you mean 'fast'?"),
        ("train vae -d no -o out --preset", "--preset needs a value"),
        ("train vae -d no -o out", "no: expected a prepared data set"),
        ("data prepare uestc -o out", "FOLDER is missing"),
        ("experiment run vae -d no -o out --rows real b", "unknown row 'b'"),
    ],
)
def test_mistakes_are_named(
    words: str, message: str, tmp_path, monkeypatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    told = [row for row in capsys.readouterr().err.splitlines() if not row.startswith("warning:")]
    assert stop.value.code == 2 and len(told) == 1 and told[0].startswith(f"error: {message}")
    assert not list(tmp_path.iterdir())


def test_the_defaults_of_training_are_those_of_the_preset() -> None:
    rows = interface(helped("train vae --preset mld_humanml3d"))
    assert "  --steps INT  (default: 1100000)" in rows
    assert "  --schedule {cosine,constant}  (default: constant)" in rows


def test_the_overview_loads_nothing_that_is_slow() -> None:
    code = (
        "import sys; from latentmotion.cli.main import main; main(['--help']); "
        "print({'torch', 'onnxruntime', 'tyro', 'numpy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "swap-decoder" in done.stdout
    assert done.stdout.splitlines()[-1] == "set()"
