"""What is published: README, sdist, versions, recipe, workflow and containers agree."""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version

from latentmotion import __version__

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
BUILD = PROJECT["tool"]["hatch"]["build"]["targets"]
PYTHONS = [
    name.rpartition(" :: ")[2]
    for name in PROJECT["project"]["classifiers"]
    if re.search(r":: 3\.\d+$", name)
]
ADDON = ROOT / "src" / "latentmotion" / "blender" / "latentmotion_blender"


def parsed(name: str) -> Any:
    """Returns a YAML file; of conda's templates only variables that are set to a text are known."""
    text = (ROOT / name).read_text(encoding="utf-8")
    for variable, value in re.findall(r'{% set (\w+) = "([^"]+)" %}', text):
        text = text.replace(f"{{{{ {variable} }}}}", value)
    text = re.sub(r"{%.*?%}", "", text)
    return yaml.safe_load(re.sub(r"{{ (\w+) }}", r"\1", text))


@pytest.fixture
def hook(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The build hook, without hatchling."""
    interface = ModuleType("interface")
    interface.MetadataHookInterface = object  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", interface)
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_links_of_the_published_readme_lead_to_files_of_the_repository(hook: ModuleType) -> None:
    links = re.findall(r"\]\(([^)]*)\)", hook.absolute((ROOT / "README.md").read_text()))
    ours = [link for link in links if "latentmotion/latentmotion/" in link]
    assert len(ours) > 20 and all(link.startswith("http") for link in links)
    for link in ours:
        assert (ROOT / re.split(r"/main/|#", link)[1]).exists(), link


def test_absolute_links_and_anchors_stay(hook: ModuleType) -> None:
    text = "[a](http://b.c) [d](#e)"
    assert hook.absolute(text) == text
    assert hook.absolute("![p](x.gif) [q](y.md)") == (
        f"![p]({hook.PICTURES}x.gif) [q]({hook.REPOSITORY}y.md)"
    )


def test_the_sdist_has_what_tests_read() -> None:
    included = BUILD["sdist"]["include"]
    for name in ("tests", "docs", "data", "Makefile", "mkdocs.yml", ".importlinter", ".github"):
        assert f"/{name}" in included


def test_files_that_the_project_names_exist() -> None:
    named = [*BUILD["sdist"]["include"], *BUILD["wheel"]["packages"], *BUILD["wheel"]["exclude"]]
    for pattern in (*named, *PROJECT["project"]["license-files"], "hatch_build.py"):
        assert list(ROOT.glob(pattern.lstrip("/"))), pattern
    for target in PROJECT["project"]["scripts"].values():
        module, _, name = target.partition(":")
        assert callable(getattr(import_module(module), name))


def test_one_version_everywhere() -> None:
    web = json.loads((ROOT / "packages" / "web" / "package.json").read_text())
    lock = json.loads((ROOT / "packages" / "web" / "package-lock.json").read_text())
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text())
    found = [
        parsed("CITATION.cff")["version"],
        parsed("recipe/meta.yaml")["package"]["version"],
        *(web["version"], lock["version"], lock["packages"][""]["version"]),
        manifest["version"],
    ]
    for page in ("CHANGELOG.md", "docs/release_notes.md"):
        found += re.findall(r"^## (\S+)", (ROOT / page).read_text(encoding="utf-8"), re.M)[:1]
    assert len(found) == 8 and set(map(Version, found)) == {Version(__version__)}
    assert parsed("CITATION.cff")["version"] == __version__
    tree = ast.parse((ADDON / "__init__.py").read_text())
    about = next(node for node in ast.walk(tree) if isinstance(node, ast.Dict))
    assert ast.literal_eval(about)["version"] == Version(__version__).release


def test_the_recipe_needs_what_the_project_needs() -> None:
    recipe = parsed("recipe/meta.yaml")
    project = PROJECT["project"]
    ours = {(one.name, str(one.specifier)) for one in map(Requirement, project["dependencies"])}
    theirs = {tuple(line.split(" ")) for line in recipe["requirements"]["run"]}
    assert theirs == ours | {("python", ">=python_min")}
    least = parsed("recipe/conda_build_config.yaml")["python_min"]
    assert project["requires-python"] == f">={least[0]}"
    host = [Requirement(line) for line in recipe["requirements"]["host"] if "python" not in line]
    assert Requirement(PROJECT["build-system"]["requires"][0]) in host
    assert all((ROOT / name).is_file() for name in recipe["about"]["license_file"])
    assert recipe["about"]["license"] == project["license"]
    (name, target) = next(iter(project["scripts"].items()))
    assert recipe["build"]["entry_points"] == [f"{name} = {target}"]


def test_the_workflow_publishes_tags_without_a_token() -> None:
    workflow = parsed(".github/workflows/publish.yml")
    triggers = workflow[True]  # how YAML 1.1 reads `on`
    assert triggers == {"push": {"tags": ["v[0-9]*"]}}
    jobs = workflow["jobs"]
    order = {name: job.get("needs") for name, job in jobs.items()}
    assert order == {"build": None, "install": "build", "publish": "install", "release": "publish"}
    rights = {name: job["permissions"] for name, job in jobs.items() if "permissions" in job}
    assert workflow["permissions"] == {"contents": "read"}
    assert rights == {"publish": {"id-token": "write"}, "release": {"contents": "write"}}
    assert "secrets." not in (ROOT / ".github/workflows/publish.yml").read_text(encoding="utf-8")
    assert jobs["install"]["strategy"]["matrix"]["python"] == PYTHONS


def test_the_workflow_of_tests_has_every_system_and_python() -> None:
    workflow = parsed(".github/workflows/test.yml")
    assert set(workflow[True]) == {"push", "pull_request"}
    assert workflow["permissions"] == {"contents": "read"}
    jobs = workflow["jobs"]
    assert [step["run"] for step in jobs["gate"]["steps"] if "run" in step] == [".ci/run"]
    core = jobs["core"]["strategy"]["matrix"]
    assert core["python"] == PYTHONS
    assert core["include"] == [{"python": PYTHONS[0], "resolution": "lowest-direct"}]
    make = (ROOT / "Makefile").read_text(encoding="utf-8")
    rooms = re.search(r"^CORE = (.+)$", make, re.M)
    assert rooms and all((ROOT / "tests" / room).is_dir() for room in rooms[1].split())


def test_actions_and_images_are_pinned_by_digest() -> None:
    pattern = re.compile(r"^\s*(?:- )?(?:uses:|image:|FROM) (\S+)", re.M)
    named = [
        name
        for folder in (".github/workflows", "packaging")
        for path in (ROOT / folder).iterdir()
        if path.suffix in (".yml", ".yaml") or path.name.startswith("Containerfile")
        for name in pattern.findall(path.read_text(encoding="utf-8"))
    ]
    assert len(named) > 15
    for name in named:
        assert re.search(r"@(sha256:[0-9a-f]{64}|[0-9a-f]{40})$", name), name
    images = [name for name in named if name.startswith("python:")]
    assert len(set(images)) == 1


@pytest.mark.parametrize("name", ["Containerfile", "Containerfile.command"])
def test_containers_copy_what_the_build_reads(name: str) -> None:
    text = (ROOT / "packaging" / name).read_text(encoding="utf-8")
    copied = " ".join(re.findall(r"^COPY (.*) \S+$", text, re.M)).split()
    assert set(copied) == {"pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "src"}
    extras = re.search(r'"/source\[(.+)\]"', text)
    assert extras and set(extras[1].split(",")) <= set(PROJECT["project"]["optional-dependencies"])
    assert re.search(r"^USER [1-9]", text, re.M)


def test_tree_and_data_pack_stay_small() -> None:
    """Issue 10 asks for 60 MiB in the end."""
    if not (ROOT / ".git").exists():
        pytest.skip("needs a checkout")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    names = [name for name in listed.stdout.decode().split("\0") if (ROOT / name).is_file()]
    sizes = {name: (ROOT / name).stat().st_size for name in names}
    largest = sorted(sizes, key=lambda name: -sizes[name])[:10]
    assert sum(sizes.values()) <= 60 * 2**20, [(name, sizes[name]) for name in largest]
