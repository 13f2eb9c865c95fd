"""The documentation: every code block runs or at least parses, every path that is named exists.

The blocks of a page run in order, in one empty folder: its `latentmotion` commands through the
command line, its Python in one namespace. A block with a title, such as `bash title="needs data"`,
cannot run here: its commands go through the command line's own parser, its Python is compiled. Of
other programs the files, make targets and extras that a block names must exist.
"""

from __future__ import annotations

import ast
import io
import re
import shlex
import tokenize
import tomllib
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest

from latentmotion.cli import VERBS
from latentmotion.cli.main import main
from latentmotion.cli.usage import parsed

ROOT = next(folder for folder in Path(__file__).parents if (folder / "pyproject.toml").is_file())
PAGES = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^( *)```(\S*)([^\n`]*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
REPOSITORY = "https://github.com/latentmotion/latentmotion/blob/main/"
REASONS = ("needs ", "takes ")  # How a title begins that says why a block is not run.
LANGUAGES = {"bash", "python", "js", "json", "toml"}


@dataclass(frozen=True)
class Block:
    """One fenced block of code."""

    language: str
    title: str  # Empty, or why the block is not run.
    code: str

    @property
    def commands(self) -> list[list[str]]:
        """The words of every command, without `NAME=value` before it."""
        lines = self.code.replace("\\\n", " ").splitlines()
        return [words for line in lines if (words := _without_variables(line))]


def _without_variables(line: str) -> list[str]:
    words = shlex.split(line, comments=True)
    while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
        words.pop(0)
    return words


def blocks(page: Path) -> Iterator[Block]:
    """Yields the code blocks of a page."""
    for indent, language, rest, code in FENCE.findall(page.read_text(encoding="utf-8")):
        title = re.fullmatch(r' title="([^"]+)"', rest)
        assert title or not rest, f"{page.name}: unknown mark of a block:{rest}"
        lines = [line.removeprefix(indent) for line in code.splitlines()]
        yield Block(language, title[1] if title else "", "\n".join(lines) + "\n")


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def runs(page: Path) -> bool:
    """Whether some block of a page is run, not only checked."""
    ours = [block for block in blocks(page) if not block.title]
    return any(
        block.language == "python" or any(words[0] == "latentmotion" for words in block.commands)
        for block in ours
        if block.language in ("python", "bash")
    )


WITH_CODE = [page for page in PAGES if any(blocks(page))]


def test_there_are_pages_to_check() -> None:
    assert sum(map(runs, PAGES)) >= 8
    assert sum(len(list(blocks(page))) for page in PAGES) >= 60


@pytest.mark.parametrize("page", WITH_CODE, ids=name_of)
def test_blocks_name_language_and_reason(page: Path) -> None:
    for block in blocks(page):
        assert block.language in LANGUAGES, f"a block in {block.language or 'no language'}"
        assert not block.title or block.title.startswith(REASONS), block.title


@pytest.mark.parametrize("page", WITH_CODE, ids=name_of)
def test_blocks_are_valid(page: Path) -> None:
    for block in blocks(page):
        if block.language == "python":
            ast.parse(block.code)
            _check_imports(block.code)
        elif block.language == "bash":
            for words in block.commands:
                check_command(words)


def _check_imports(code: str) -> None:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = import_module(node.module)
            missing = [name.name for name in node.names if not hasattr(module, name.name)]
            assert not missing, f"{node.module} has no {missing}"


def check_command(words: list[str]) -> None:
    """Checks one command of a block: our own by its parser, others by the files that they name."""
    program, *rest = words
    if program == "torchrun" or words[:3] == ["python", "-m", "latentmotion"]:
        program, rest = "latentmotion", words[words.index("latentmotion") + 1 :]
    if program == "latentmotion":
        _parse(rest)
    elif program == "make":
        assert f"\n{rest[0]}:" in (ROOT / "Makefile").read_text(encoding="utf-8"), words
    elif program == "python" and rest[0] != "-m":
        assert (ROOT / rest[0].removeprefix("CLONE/")).is_file(), words
    elif program == "pip":
        _check_extras(rest)
    else:
        others = (
            "export",
            "python",
            ".ci/run",
            ".venv/bin/pre-commit",
            "curl",
            "docker",
            "openssl",
            "blender",
            "claude",
        )
        assert program in others, words


def _parse(words: list[str]) -> None:
    name = next((" ".join(words[:n]) for n in (3, 2, 1) if " ".join(words[:n]) in VERBS), None)
    assert name, f"no command of ours: {words}"
    module, _, command = VERBS[name].target.partition(":")
    parsed(
        getattr(import_module(f"latentmotion.cli.{module}"), command),
        name,
        words[len(name.split()) :],
    )


def _check_extras(words: list[str]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for word in words:
        for extras in re.findall(r"^(?:\.|CLONE|latentmotion)\[(.+)\]$", word):
            assert set(extras.split(",")) <= set(project["optional-dependencies"]), word


@pytest.mark.parametrize("page", [page for page in PAGES if runs(page)], ids=name_of)
def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for block in blocks(page):
        if block.title:
            continue
        if block.language == "python":
            exec(compile(block.code, name_of(page), "exec"), names)
        elif block.language == "bash":
            _run(block)


def _run(block: Block) -> None:
    for words in block.commands:
        if words[0] == "latentmotion":
            with warnings.catch_warnings():
                warnings.simplefilter("default")
                main(words[1:])


@pytest.mark.parametrize("page", [*PAGES, *sorted((ROOT / "lab").rglob("*.md"))], ids=name_of)
def test_links_lead_to_files(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path = target.partition("#")[0]
        if path.startswith(REPOSITORY):
            assert (ROOT / path.removeprefix(REPOSITORY)).exists(), target
        elif path and not path.startswith(("http://", "https://", "reference/api/")):
            assert (page.parent / path).exists(), target


SOURCES = [
    path
    for folder in ("src", "tests", "benchmarks", "examples")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".md", ".toml") and path != Path(__file__)
]


def test_pages_that_code_cites_exist() -> None:
    cited = {
        (path.relative_to(ROOT).as_posix(), page)
        for path in SOURCES
        for page in re.findall(r"\b(?:docs|lab)/[\w/.-]+\.md", path.read_text(encoding="utf-8"))
    }
    assert [pair for pair in sorted(cited) if not (ROOT / pair[1]).is_file()] == []


NAMING_FILES = [page for page in PAGES if {"guide", "reference"} & set(page.parts)]


@pytest.mark.parametrize("page", NAMING_FILES, ids=name_of)
def test_source_files_that_pages_name_exist(page: Path) -> None:
    for path in re.findall(r"`([a-z_0-9]+(?:/[a-z_0-9]+)*\.py)`", page.read_text("utf-8")):
        assert any((root / path).is_file() for root in (ROOT, ROOT / "src/latentmotion")), path


def test_the_architecture_page_names_every_room() -> None:
    page = (ROOT / "docs/reference/architecture.md").read_text("utf-8")
    rooms = set(re.findall(r"`([a-z]+)/`", page))
    folders = {path.parent.name for path in (ROOT / "src/latentmotion").glob("*/__init__.py")}
    assert folders <= rooms, folders - rooms


def test_sections_of_the_reference_that_code_cites_exist() -> None:
    reference = (ROOT / "docs/reference/mld.md").read_text(encoding="utf-8")
    sections = set(re.findall(r"^## (\d+)\. ", reference, re.MULTILINE))
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        for cited in re.findall(r"mld\.md\s(§\d+(?:,\s§\d+)*)", text):
            assert set(re.findall(r"\d+", cited)) <= sections, f"{path}: {cited}"


def test_every_command_stands_in_the_table_of_commands() -> None:
    page = (ROOT / "docs/reference/commands.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([a-z0-9 -]+)` \|", page, re.MULTILINE)) == set(VERBS)


SOURCE_FILE = re.compile(r"(?<![\w/.-])((?:[\w-]+/)*[A-Za-z_][\w-]*\.(?:py|js))\b")


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """Yields docstrings and comments of a file that may name others, with their lines."""
    text = path.read_text(encoding="utf-8")
    if not SOURCE_FILE.search(text):  # most files: to read them closely takes seconds
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield node.lineno, str(node.value.value)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def missing_files(path: Path, files: frozenset[str]) -> list[str]:
    """Returns what a file's docstrings and comments call by the name of no file of the tree."""
    return [
        f"{path.name}:{line} {name}"
        for line, text in prose(path)
        for name in SOURCE_FILE.findall(text)
        if not any(file.endswith(f"/{name}") for file in files)
    ]


def test_source_files_that_docstrings_and_comments_name_exist(tmp_path: Path) -> None:
    folders = [ROOT / name for name in ("src", "tests", "benchmarks", "examples", "packages")]
    paths = [
        path
        for folder in folders
        for path in folder.rglob("*")
        if path.suffix in (".py", ".js") and "node_modules" not in path.parts
    ]
    files = frozenset(path.as_posix() for path in paths)
    sources = [path for path in paths if path.suffix == ".py"]
    assert len(sources) > 500
    assert [each for path in sources for each in missing_files(path, files)] == []
    wrong = tmp_path / "wrong.py"
    wrong.write_text('"""As `no_such_room/gone.py` says."""\n\nN = 1  # see absent.js\n')
    assert missing_files(wrong, files) == [
        "wrong.py:1 no_such_room/gone.py",
        "wrong.py:3 absent.js",
    ]
