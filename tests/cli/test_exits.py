"""How verbs end: exit codes, warnings, what is read of words, and mistakes before heavy work."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli import usage
from latentmotion.cli.evaluate import Evaluate
from latentmotion.cli.main import main
from latentmotion.errors import (
    DataError,
    FileFormatError,
    InputError,
    LatentMotionError,
    MissingExtraError,
    MissingProgramError,
    ModelError,
    hint,
)
from latentmotion.evaluation.protocol import CLEAN, PAPER
from latentmotion.motion import Motion
from tests.cli.conftest import Refused
from tests.support.mocap_folders import write_own
from tests.support.moving_figures import write_moving_figures
from tests.support.simple_motions import figure


@pytest.fixture
def verb(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], None]:
    """Makes the verb `clean` run what is given."""

    def replace_with(run: Callable[[], object]) -> None:
        monkeypatch.setattr(usage, "parsed", lambda *_: SimpleNamespace(run=run))

    return replace_with


def raising(error: BaseException) -> Callable[[], object]:
    def run() -> None:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (InputError("wrong"), 2, "error: wrong\n"),
        (DataError("a: b"), 2, "error: a: b\n"),
        (ModelError("no"), 2, "error: no\n"),
        (FileFormatError("a.bvh", "bad", 3), 2, "error: a.bvh:3: bad\n"),
        (FileFormatError("a.bvh", "bad"), 2, "error: a.bvh: bad\n"),
        (MissingProgramError("no Blender"), 2, "error: no Blender\n"),
        (
            MissingExtraError("video", "av", "video"),
            2,
            "error: video needs av, which is not installed; run: pip install "
            '"latentmotion[video]"\n',
        ),
        (
            ModuleNotFoundError("No module named 'av'", name="av"),
            2,
            "error: latentmotion clean needs av, which is not installed; run: pip install "
            '"latentmotion[train]"\n',
        ),
        (KeyboardInterrupt(), 130, ""),
    ],
    ids=lambda value: type(value).__name__,
)
def test_errors_end_in_a_code_and_a_line(
    verb, error: BaseException, code: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    verb(raising(error))
    with pytest.raises(SystemExit) as stop:
        main(["clean"])
    assert (stop.value.code, capsys.readouterr().err) == (code, told)


@pytest.mark.parametrize(
    "error",
    [
        ModuleNotFoundError("No module named 'latentmotion.x'", name="latentmotion.x"),
        ModuleNotFoundError("nameless"),
        ZeroDivisionError("a bug"),
    ],
    ids=lambda error: str(error),
)
def test_bugs_of_our_own_are_not_hidden(verb, error: Exception) -> None:
    verb(raising(error))
    with pytest.raises(type(error)):
        main(["clean"])


def test_warnings_take_a_line_each(verb, capsys: pytest.CaptureFixture[str]) -> None:
    def run() -> None:
        warnings.warn("look out", stacklevel=1)
        print("done")

    verb(run)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        main(["clean"])
    assert capsys.readouterr() == ("done\n", "warning: look out\n")


def test_every_error_of_ours_is_of_one_family() -> None:
    kinds = (InputError, DataError, ModelError, FileFormatError, MissingExtraError)
    assert all(issubclass(kind, LatentMotionError) for kind in (*kinds, MissingProgramError))


@pytest.mark.parametrize(
    ("name", "told"),
    [("wlak", "did you mean 'walk'?"), ("xyz", "known are walk, run"), ("", "known are walk, run")],
)
def test_a_hint_is_the_nearest_name_or_all(name: str, told: str) -> None:
    assert hint(name, iter(["walk", "run"])) == told


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, (1, "test", 100, None)),
        ({"evaluator": Path("e")}, (CLEAN.replications, "test", 100, None)),
        ({"evaluator": Path("e"), "protocol": "paper"}, (PAPER.replications, "test", 100, None)),
        ({"replications": 3, "multimodality": 0, "split": "val"}, (3, "val", 0, None)),
        ({"max_frames": 60}, (1, "test", 100, 60)),
    ],
)
def test_protocols_are_changed_as_options_say(options: dict, expected: tuple) -> None:
    protocol = Evaluate(**options).changed_protocol()
    found = protocol.replications, protocol.split, protocol.repeats.texts, protocol.max_frames
    assert found == expected


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("place")
    write_moving_figures(place / "data", train=2, val=2)
    write_own(place / "mine", ["walk"])
    formats.save(place / "walk.npz", [Motion(figure(1.0, speed=1.0).astype("f4"))])
    return place


TRAIN_VAE = "train vae --data data -o out --device cpu --set"
WRONG = {
    f"{TRAIN_VAE} vae_training": "'vae_training': expected KEY=VALUE",
    f"{TRAIN_VAE} vae_trainin.steps=3": "unknown key 'vae_trainin'; did you mean 'vae_training'?",
    f"{TRAIN_VAE} vae_training.stepps=3": "unknown key 'stepps'; did you mean 'steps'?",
    f"{TRAIN_VAE} vae_training.steps=many": "vae_training.steps: expected int, found 'many'",
    f"{TRAIN_VAE} vae_training.steps=1.5": "vae_training.steps: expected int, found 1.5",
    f"{TRAIN_VAE} vae_training.steps=true": "vae_training.steps: expected int, found True",
    f"{TRAIN_VAE} mirrored.x=1": "mirrored is a plain value and has no 'x'",
    f"{TRAIN_VAE} task=dance": "task: expected one of text, action, unconditional",
    "data compose data -o out --count 0": "count 0, seed 0; expected at least 1",
    "data compose data -o out --count 3 --seed -1": "count 3, seed -1; expected",
    "data describe data -o out --windows -1": "expected --windows and --rewordings of 0",
    "data describe data -o out --sentences 0": "and --sentences of 1 or more",
    "data describe data -o out --names": "data is prepared data, so --names has no effect",
    "data describe data -o out.csv": "a prepared folder becomes one; add --edit for a CSV",
    "data describe data -o mine": "exists and has no manifest.json",
    "data unpack walk.npz -o out": "no data pack; make one with",
    "data pack mine -o out.pack": "expected a prepared data set",
    "data pack data -o out.pack --quantum 100": "a quantum of 0.1 m; expected 1e-06 to 0.01",
    "evaluate": "MODEL is missing; see latentmotion evaluate --help",
    "evaluate starter": "--data is missing; see latentmotion evaluate --help",
    "evaluate --instructions": "MODEL is missing; name one, or a folder of joints by --joints",
    "evaluate starter --joints mine": "give either MODEL (starter) or --joints, not both",
    "evaluate --instructions --takes 0": "--takes 0: expected 1 or more",
    "clean walk.npz -o walk.xyz": "the ending '.xyz'",
    "clean walk.npz -o no/walk.bvh": "does not exist; create it",
    "clean none.npz -o out.bvh": "none.npz",
    "clean walk.npz -o out.bvh --cutoff 0": "cutoff",
    "experiment list vaee": "did you mean 'vae'?",
    "generate walk --prior --model starter": "--prior takes no prompt; leave 'walk' out",
    "edit walk.npz jump --between 5 2 -o out.bvh": "5",
}


@pytest.mark.parametrize("words", WRONG)
def test_mistakes_are_told_before_anything_is_written(
    words: str, place: Path, refused: Refused
) -> None:
    assert WRONG[words] in refused(words, place, warned=True)


def test_cleaning_by_command_is_cleaning_in_python(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    targets = [str(tmp_path / name) for name in ("out.npz", "out.csv")]
    main(["clean", str(place / "walk.npz"), "-o", *targets, "--no-smooth", "--in-place"])
    *wrote, figures = capsys.readouterr().out.splitlines()
    assert wrote == [f"wrote {path}" for path in targets]
    assert "joints moved" in figures and "feet slide" in figures
    (found,) = formats.load(targets[0])
    assert np.ptp(found.joints[:, 0, [0, 2]]) < 1e-3
    np.testing.assert_allclose(formats.load(targets[1])[0].joints, found.joints, atol=1e-6)


@pytest.mark.parametrize(("table", "listed"), [("", "vae"), ("vae", "MLD-5")])
def test_tables_and_their_rows_are_listed(
    table: str, listed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["experiment", "list", *table.split()])
    printed = capsys.readouterr().out
    assert listed in printed and len(printed.splitlines()) > 3
