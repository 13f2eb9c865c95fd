"""Plugins: the package that the guide shows adds one of each kind; broken ones harm nothing."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from latentmotion import load, plugins
from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError, InputError
from latentmotion.kinematics.bone_names import find_joint_map, joint_maps, weights_of
from latentmotion.kinematics.humanoid import find_humanoid
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion
from latentmotion.training.run_folder import Journal
from tests.support.walker import walker

PAGE = (Path(__file__).parents[1] / "docs" / "guide" / "plugins.md").read_text(encoding="utf-8")
MODULE, PROJECT = (
    re.search(rf"```{language}\n(.*?)```", PAGE, re.S)[1]  # type: ignore[index]
    for language in ("python", "toml")
)


def install(folder: Path, module: str, code: str, entries: dict[str, dict[str, str]]) -> None:
    """Writes what pip would: a module and the metadata of its distribution."""
    (folder / f"{module}.py").write_text(code, encoding="utf-8")
    about = folder / f"{module}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    lines = [
        line
        for group, names in entries.items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in names.items()))
    ]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the module path with the guide's package, and a broken one."""
    folder = tmp_path / "site"
    folder.mkdir()
    install(folder, "lab", MODULE, tomllib.loads(PROJECT)["project"]["entry-points"])
    broken = {
        "latentmotion.formats": {"bad": "broken"},
        "latentmotion.skeletons": {"absent": "broken:nothing"},
        "latentmotion.data_sources": {"bare": "json"},
        "latentmotion.loggers": {"closed": "json:loads"},
    }
    install(folder, "broken", "raise ImportError('no such library')\n", broken)
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
    plugins._loaded.cache_clear()
    monkeypatch.delitem(sys.modules, "lab", raising=False)
    return folder


def renamed(names: dict[str, str]) -> Skeleton:
    """Returns HumanML3D's skeleton with other names of its joints."""
    ours = walker(2).skeleton
    found = tuple(names[name] for name in ours.names)
    return Skeleton("other", found, ours.parents, ours.offsets)


def test_a_format_is_written_and_read(installed: Path, tmp_path: Path) -> None:
    motion = Motion(walker(12).joints())
    assert motion.save(tmp_path / "a.XYZ") == [tmp_path / "a.XYZ"]
    (read,) = load(tmp_path / "a.XYZ")
    np.testing.assert_allclose(read.joints, motion.joints, atol=1e-6)


def test_files_of_a_plugin_are_own_data_and_searched(
    installed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    Motion(walker(60).joints()).save(mine / "walk.xyz")
    (mine / "walk.txt").write_text("a person walks\n")
    main(["data", "prepare", "own", str(mine), "-o", str(tmp_path / "out")])
    (clip,) = Dataset.load(tmp_path / "out").manifest.clips
    assert (clip.id, clip.captions[0][0]) == ("walk", "a person walks")
    capsys.readouterr()
    main(["search", str(mine), "a walk", "--index", str(tmp_path / "index")])
    assert capsys.readouterr().out.endswith("mine/walk.xyz\n")


def test_a_skeleton_is_found_by_its_names(installed: Path) -> None:
    names = [f"joint {number}" for number in range(22)]
    with pytest.warns(RuntimeWarning, match="the plugin 'absent' of latentmotion.skeletons"):
        found = find_joint_map(names)
    assert found is not None and list(found.values()) == names
    mixamo = [
        f"mixamorig:{name}" for each in joint_maps()["mixamo"].values() for name in weights_of(each)
    ]
    assert find_joint_map(mixamo) is joint_maps()["mixamo"]
    assert find_joint_map(["a", "b"]) is None


def test_a_rig_is_retargeted_by_the_names_of_a_plugin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {name: f"q{number}" for number, name in enumerate(joint_maps()["humanml3d"])}
    with pytest.raises(DataError, match="unknown names"):
        find_humanoid(renamed(names))
    install(tmp_path, "quiet", f"NAMES = {names}", {"latentmotion.skeletons": {"q": "quiet:NAMES"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    found = find_humanoid(renamed(names))
    assert found.joints["left_wrist"] == walker(2).skeleton.names.index("left_wrist")


def test_a_data_source_is_prepared(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "raw").mkdir()
    Motion(walker(60).joints()).save(tmp_path / "raw" / "a_person_walks.xyz")
    raw, out = str(tmp_path / "raw"), str(tmp_path / "out")
    main(["data", "prepare", "plugin", "lab", raw, "-o", out])
    dataset = Dataset.load(tmp_path / "out")
    assert [source.credit for source in dataset.sources] == ["The motion lab"]
    assert dataset.manifest.clips[0].captions[0][0] == "a person walks"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("lap", "latentmotion.data_sources: nothing is called 'lap'; did you mean 'lab'?"),
        ("bare", "the data source 'bare' lacks SOURCE and recordings"),
    ],
)
def test_a_wrong_data_source_is_named(
    name: str, told: str, installed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["data", "prepare", "plugin", name, str(tmp_path), "-o", str(tmp_path / "out")])
    assert capsys.readouterr().err == f"error: {told}\n"


def test_a_logger_is_told_the_figures(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LATENTMOTION_LOGGERS", "figures,closed")
    with pytest.warns(RuntimeWarning, match="the plugin 'closed' of latentmotion.loggers"):
        journal = Journal(tmp_path, steps=4)
    journal.write(2, "train", {"total": 0.5})
    journal.close()
    assert (tmp_path / "figures.txt").read_text() == "2 train ('total', 0.5)\n"


def test_a_logger_that_fails_is_left_out(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LATENTMOTION_LOGGERS", "figures")
    journal = Journal(tmp_path, steps=4)
    journal._loggers["figures"].close()
    with pytest.warns(RuntimeWarning, match="'figures'.*left out: ValueError: I/O") as told:
        journal.write(1, "train", {"total": 0.5})
        journal.write(2, "train", {"total": 0.4})
        journal.close()
    assert len(told) == 1 and len((tmp_path / "journal.jsonl").read_text().splitlines()) == 2


def test_an_unknown_logger_is_refused(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LATENTMOTION_LOGGERS", "figure")
    with pytest.raises(InputError, match="no logger 'figure'; did you mean 'figures'"):
        Journal(tmp_path, steps=4)


def test_a_broken_plugin_is_named_once(installed: Path, tmp_path: Path) -> None:
    with pytest.warns(RuntimeWarning) as told:
        for _ in range(2):
            with pytest.raises(InputError, match=r"cannot be read: .*known are .*, \.bad, \.xyz"):
                load(tmp_path / "a.bad")
    reason = "the plugin 'bad' of latentmotion.formats is left out: ImportError: no such library"
    assert [str(warning.message) for warning in told] == [reason]
    assert Motion(walker(12).joints()).save(tmp_path / "a.xyz")


def test_nothing_is_loaded_before_it_is_needed(installed: Path, tmp_path: Path) -> None:
    code = (
        "import sys, latentmotion; from latentmotion import formats, plugins;"
        "from latentmotion.kinematics.humanoid import find_humanoid;"
        f"formats.check_ending({str(tmp_path / 'a.bvh')!r});"
        "print({'lab', 'broken'} & set(sys.modules))"
    )
    folders = [str(installed), *filter(None, sys.path)]
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={"PYTHONPATH": ":".join(folders)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "set()\n"
