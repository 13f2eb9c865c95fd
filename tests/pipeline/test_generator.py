"""The chain with the model that ships: repeatable, whatever the batch and the engine."""

from __future__ import annotations

import json
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.engine.session import Runtime
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import find_model
from latentmotion.motion import Motion

CAPTION = "a person walks forward"


@pytest.fixture(scope="module")
def generate() -> MotionPipeline:
    return MotionPipeline.from_pretrained("starter", runtime="onnxruntime", threads=1)


@pytest.fixture(scope="module")
def walk(generate: MotionPipeline) -> Motion:
    return generate(CAPTION, seconds=2, seed=3, takes=1, clean_up=None)


def test_a_walk_goes_forward_on_alternating_feet(walk: Motion) -> None:
    assert walk.joints.shape == (40, 22, 3)
    assert (walk.caption, walk.metadata["seed"]) == (CAPTION, 3)
    root, head = walk.joints[:, 0], walk.joints[:, 15]
    assert root[-1, 2] - root[0, 2] > 0.5, "walks less than half a meter ahead"
    assert (head[:, 1] > root[:, 1] + 0.3).all(), "is not upright"
    lead = walk.joints[:, 7, 2] - walk.joints[:, 8, 2]
    assert lead.max() > 0.15 and lead.min() < -0.15, "one foot is never ahead of the other"


def test_other_sentences_make_other_movements(generate: MotionPipeline) -> None:
    sentences = [
        "a person lies down on the floor",
        "a person jumps forward",
        "a person kicks with the right leg",
        "a person jogs in a circle to the left",
    ]
    lie, jump, kick, circle = (m.joints for m in generate.batch(sentences, 4, seeds=[0, 1, 0, 0]))
    assert lie[-1, 15, 1] < 0.5, "the head of who lies down stays up"
    assert jump[:, 0, 1].max() > jump[0, 0, 1] + 0.15, "who jumps stays on the floor"
    assert kick[:, 11, 1].max() > kick[:, 10, 1].max() + 0.3, "the wrong foot kicks"
    across = circle[:, 1] - circle[:, 2]
    turned = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    assert turned[-1] - turned[0] > 1.0, "who jogs in a circle to the left does not turn left"


def test_the_same_seed_gives_the_same_motion(generate: MotionPipeline) -> None:
    first, second, other = (
        generate(CAPTION, 2, seed, steps=4, takes=1, clean_up=None) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.joints, second.joints)
    assert np.abs(first.joints - other.joints).max() > 0.01


def test_a_motion_is_the_same_in_any_batch(generate: MotionPipeline) -> None:
    captions = ["a person jumps", CAPTION, "someone kicks with the right leg"]
    together = generate.batch(captions, 2, seeds=[9, 5, 7], steps=4)
    alone = generate(CAPTION, 2, seed=5, steps=4, takes=1, clean_up=None)
    np.testing.assert_allclose(together[1].joints, alone.joints, atol=1e-3)


def test_lengths_may_differ_in_a_batch(generate: MotionPipeline) -> None:
    captions = ["a person jumps", CAPTION, "someone kicks with the right leg"]
    seconds, seeds = (3, 1.2, 2), [9, 5, 7]
    for sampler in ("ddim", "ddpm"):
        options = {"steps": 4, "sampler": sampler}
        together = generate.batch(captions, seconds, seeds, **options)
        for motion, caption, length, seed in zip(together, captions, seconds, seeds, strict=True):
            alone = generate(caption, length, seed, takes=1, clean_up=None, **options)
            np.testing.assert_allclose(motion.joints, alone.joints, atol=1e-3)


def test_features_are_what_motions_are_made_of(generate: MotionPipeline) -> None:
    features = generate.features([CAPTION, "a person walks"], [41, 24], [3, 4], steps=2)
    assert [each.shape for each in features] == [(41, 263), (24, 263)]
    motion = generate("a person walks", 1.2, seed=4, steps=2, takes=1, clean_up=None)
    joints = generate.representation.decode(features[1])
    np.testing.assert_allclose(joints, motion.joints, atol=1e-3)
    with pytest.raises(InputError, match="3 seeds for 2 motions"):
        generate.features([CAPTION] * 2, [40, 40], [1, 2, 3])
    with pytest.raises(InputError, match="2 prompts for 1 length"):
        generate.features([CAPTION] * 2, [40], [1])
    assert generate.features([], [], []) == []


def test_more_motions_than_go_at_once(generate: MotionPipeline) -> None:
    motions = generate.batch([CAPTION] * 33, 1, steps=1)
    assert [motion.metadata["seed"] for motion in motions] == list(range(33))


def test_both_engines_agree(walk: Motion) -> None:
    pytest.importorskip("openvino")
    other = MotionPipeline.from_pretrained("starter", runtime="openvino", threads=1)
    (found,) = other.batch([CAPTION], 2, [3])
    np.testing.assert_allclose(found.joints, walk.joints, atol=5e-3)


@pytest.mark.parametrize("runtime", ["onnxruntime", "openvino"])
def test_a_folder_of_links_is_a_model(runtime: str, walk: Motion, tmp_path: Path) -> None:
    pytest.importorskip(runtime)
    for file in find_model("starter").iterdir():
        (tmp_path / file.name).symlink_to(file)
    linked = MotionPipeline.from_pretrained(tmp_path, runtime=runtime, threads=1)
    (found,) = linked.batch([CAPTION], 2, [3])
    np.testing.assert_allclose(found.joints, walk.joints, atol=5e-3)


def test_length_is_what_was_asked_for(generate: MotionPipeline) -> None:
    assert [len(generate(CAPTION, s, steps=1, takes=1)) for s in (1.0, 1.35, 9.8)] == [20, 27, 196]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"prompt": "  "}, "sentence is empty"),
        ({"prompt": "kickLFront1Reps"}, "looks like a label"),
        ({"seconds": 0}, "0 seconds"),
        ({"seconds": 1000}, "makes motions of .* to 9.8 seconds"),
        ({"seconds": float("nan")}, "nan seconds"),
        ({"seed": -1}, "seed -1"),
        ({"steps": 0}, "0 sampling steps"),
        ({"guidance": -3.0}, "guidance -3"),
    ],
)
def test_numbers_out_of_range(generate: MotionPipeline, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        generate(**{"prompt": CAPTION, **options})


def test_unknown_words_are_named_and_survive(generate: MotionPipeline) -> None:
    with pytest.warns(UserWarning, match="qzxv"):
        motion = generate("a person qzxvs", 1, steps=1, takes=1)
    assert np.isfinite(motion.joints).all()


def test_models_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="did you mean 'starter'"):
        MotionPipeline.from_pretrained("startr")
    with pytest.raises(ModelError, match="not a model folder"):
        MotionPipeline.from_pretrained(tmp_path)


@pytest.mark.parametrize("runtime", ["onnxruntime", "openvino"])
def test_a_damaged_graph_is_named(runtime: Runtime, tmp_path: Path) -> None:
    pytest.importorskip(runtime)
    shutil.copytree(find_model("starter"), tmp_path / "damaged")
    (tmp_path / "damaged" / "denoiser.onnx").write_bytes(b"not a graph")
    generate = MotionPipeline.from_pretrained(tmp_path / "damaged", runtime)
    with pytest.raises(ModelError, match=r"denoiser\.onnx cannot be loaded"):
        generate(CAPTION, 1)
    (tmp_path / "damaged" / "denoiser.onnx").unlink()
    with pytest.raises(ModelError, match=r"denoiser\.onnx is missing"):
        MotionPipeline.from_pretrained(tmp_path / "damaged", runtime)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux does")
@pytest.mark.parametrize("runtime", ["onnxruntime", "openvino"])
def test_no_more_threads_work_than_were_asked_for(runtime: Runtime) -> None:
    pytest.importorskip(runtime)
    code = f"""
from pathlib import Path
from latentmotion import MotionPipeline

def ticks():
    stats = ((task.name, (task / "stat").read_text()) for task in Path("/proc/self/task").iterdir())
    return {{name: sum(map(int, stat.rpartition(")")[2].split()[11:13])) for name, stat in stats}}

generate = MotionPipeline.from_pretrained("starter", {runtime!r}, threads=1)
work = lambda: generate.batch(["a person walks"] * 4, 9, steps=2)
work()  # Graphs are compiled, by more threads.
before, worked = ticks(), [0]
while max(worked) < 50:
    work()
    worked = [after - before.get(name, 0) for name, after in ticks().items()]
print(*sorted(worked))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *others, busiest = map(int, done.stdout.split())
    assert sum(others) < 0.2 * busiest


def test_a_number_of_threads_is_checked_at_once() -> None:
    with pytest.raises(InputError, match="0 threads: expected 1 or more"):
        MotionPipeline.from_pretrained("starter", "onnxruntime", threads=0)


def test_command_writes_every_file_and_reports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(tmp_path / name) for name in ("a.bvh", "a.npz", "a.glb", "a.html")]
    words = [CAPTION, "a person jumps", "--seconds", "1", "--steps", "2", "--seed", "7"]
    main(["generate", *words, "--best-of", "1", "--threads", "1", "--json", "-o", *files])
    report = json.loads(capsys.readouterr().out)
    assert [motion["seed"] for motion in report["motions"]] == [7, 8]
    assert all(Path(file).stat().st_size > 1000 for file in report["files"])
    assert len(Motion.load(tmp_path / "a.npz")) == 20


def test_command_without_output_writes_a_page_and_overwrites_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("motion.html", "motion-2.html"):
        main(["generate", CAPTION, "--seconds", "1", "--steps", "1", "--threads", "1"])
        assert name in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["motion-2.html", "motion.html"]


def test_what_is_neither_sentence_nor_goal_is_named() -> None:
    code = (
        "from latentmotion import MotionPipeline\n"
        "from latentmotion.errors import InputError\n"
        "generate = MotionPipeline.from_pretrained()\n"
        "for given in ({'prompt': None}, {'prompt': 'a person walks', 'goals': ['left']}):\n"
        "    try:\n"
        "        generate(**given)\n"
        "    except InputError as error:\n"
        "        print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines() == [
        "a prompt is None; expected words, or a list of prompts",
        "a goal is 'left'; expected RootPath, Reach, Heading, LookAt or Pose of latentmotion",
    ]


def test_several_prompts_are_several_motions_each_as_it_is_alone(generate: MotionPipeline) -> None:
    captions = ["a person jumps", CAPTION]
    both = generate(captions, [2, 3], takes=1)
    alone = [generate(c, s, takes=1) for c, s in zip(captions, (2, 3), strict=True)]
    for mine, expected in zip(both, alone, strict=True):
        np.testing.assert_array_equal(mine.joints, expected.joints)


def test_a_pipeline_that_was_used_can_be_pickled(generate: MotionPipeline, walk: Motion) -> None:
    content = pickle.dumps(generate)
    assert len(content) < 100_000
    other = pickle.loads(content)  # noqa: S301 - made above
    again = other(CAPTION, seconds=2, seed=3, takes=1, clean_up=None)
    np.testing.assert_array_equal(again.joints, walk.joints)


def test_wrong_arguments_are_answered_in_words() -> None:
    wrong = {
        "seconds='4'": "seconds is '4'; expected a number, such as 4.0",
        "seconds=[1, 2]": "2 lengths for one motion; expected one for each, or one",
        "seed=1.5": "seed is 1.5; expected a whole number",
        "takes=True": "takes is True; expected a whole number",
        "guidance='4'": "guidance is '4'; expected a number",
        "guidance_scale=4": "unknown argument 'guidance_scale'; it is called 'guidance' here",
        "guidence=4": "unknown argument 'guidence'; did you mean 'guidance'?",
    }
    code = (
        "from latentmotion import MotionPipeline\n"
        "from latentmotion.errors import InputError\n"
        "generate = MotionPipeline.from_pretrained()\n"
        f"for given in {list(wrong)}:\n"
        "    try:\n"
        "        eval(f'generate(\"a person walks\", {given})')\n"
        "    except InputError as error:\n"
        "        print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines() == list(wrong.values())
