"""The npm package in Node: its tokens, noise and joints are Python's.

`LATENTMOTION_WEB=1000` compares so many captions, each with a seed of its own.
"""

from __future__ import annotations

import json
import lzma
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tokenizers import Tokenizer

from latentmotion import MotionPipeline

PACKAGE = Path(__file__).parents[2] / "packages" / "web"
COUNT = int(os.environ.get("LATENTMOTION_WEB", "6"))
CAPTIONS = (
    "a person walks forward and waves",
    "Someone JUMPS twice, then sits down!",
    "a café dancer spins  around\tquickly — très vite",
    "他挥手 and 👋 waves\u00a0hello",
    "x" * 200,
    "a person waves " + "and waves " * 90,
)
SEEDS = [*range(40), 2**31, 2**32, 2**53 - 1, 2**64 + 5, 2**130 + 3]
WRONG = [
    {"prompt": " "},
    {"prompt": "a person walks", "seconds": 60},
    {"prompt": "a person walks", "seed": -1},
    {"prompt": "a person walks", "steps": 3},
    {"prompt": "a person walks", "guidance": 70},
]


def captions(count: int, shared: Path | None) -> list[str]:
    if count <= len(CAPTIONS):
        return list(CAPTIONS[:count])
    if shared is None:
        pytest.skip("needs LATENTMOTION_SHARED for so many captions")
    packed = shared / "data" / "humanml3d" / "texts.json.xz"
    texts = json.loads(lzma.decompress(packed.read_bytes()))
    lines = (line for text in texts.values() for line in text.splitlines())
    found = sorted({line.partition("#")[0] for line in lines} - {""})
    return [*CAPTIONS, *found[:: max(1, len(found) // count)]][:count]


@pytest.fixture(scope="module")
def answered(web_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    if shutil.which("node") is None:
        pytest.skip("needs Node.js (Debian: apt-get install nodejs npm)")
    if not (PACKAGE / "node_modules" / "onnxruntime-web").is_dir():
        pytest.skip("needs the package's dependencies: cd packages/web && npm ci")
    shared = os.environ.get("LATENTMOTION_SHARED")
    sentences = captions(COUNT, Path(shared) if shared else None)
    lengths = (None, 4.0, 0.7, 9.8, 2.5, 3.05)
    cases = [
        {"prompt": sentence, "seed": seed, "guidance": 1 + seed % 5, "seconds": lengths[seed % 6]}
        for seed, sentence in enumerate(sentences)
    ]
    folder = tmp_path_factory.mktemp("answers")
    given = {"model": str(web_folder), "cases": cases, "sentences": ["", *sentences]}
    given |= {"seeds": [str(seed) for seed in SEEDS], "wrong": WRONG}
    (folder / "cases.json").write_text(json.dumps(given), "utf-8")
    script = Path(__file__).with_name("web_package.mjs")
    command = ["node", str(script), str(PACKAGE), str(folder / "cases.json"), str(folder)]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    arrays = {name: np.fromfile(folder / f"{name}.f4", "<f4") for name in ("noise", "joints")}
    return json.loads(run.stdout) | arrays | given


def test_token_ids_are_pythons(answered: dict[str, Any], web_folder: Path):
    tokenizer = Tokenizer.from_file(str(web_folder / "tokenizer.json"))
    expected = [tokenizer.encode(sentence).ids for sentence in answered["sentences"]]
    assert answered["ids"] == expected
    assert max(map(len, expected)) == 128  # one sentence is cut


def test_noise_is_numpys(answered: dict[str, Any]):
    found = answered["noise"].reshape(len(SEEDS), -1)
    expected = np.stack(
        [np.random.default_rng(s).standard_normal(1568, dtype=np.float32) for s in SEEDS]
    )
    # The tail takes the C library's logarithm, which is not rounded alike everywhere.
    near = np.abs(expected) < 3.65
    np.testing.assert_array_equal(found[near].view(np.uint32), expected[near].view(np.uint32))
    np.testing.assert_array_max_ulp(found[~near], expected[~near], 1)


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.UnknownWordsWarning")
@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.LongSentenceWarning")
@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
def test_joints_are_pythons(answered: dict[str, Any], four_steps: Path):
    # The package makes one raw take, from noise, of the sentence as it stands.
    pipeline = replace(MotionPipeline.from_pretrained(four_steps, "onnxruntime", 1), moves=())
    raw: dict[str, Any] = {"steps": 4, "takes": 1, "clean_up": None}
    start, farthest = 0, 0.0
    for case, made in zip(answered["cases"], answered["made"], strict=True):
        asked = {name: case[name] for name in ("seconds", "seed", "guidance")}
        expected = pipeline(case["prompt"], **raw, **asked).joints
        assert (made["frames"], made["model"]) == (len(expected), "fast")
        found = answered["joints"][start : start + expected.size].reshape(expected.shape)
        farthest = max(farthest, float(np.linalg.norm(found - expected, axis=-1).max()))
        start += expected.size
    assert start == len(answered["joints"])
    print(f"{len(answered['cases'])} motions, joints within {1e6 * farthest:.1f} µm")
    assert farthest < 1e-4


def test_errors_say_what_was_expected(answered: dict[str, Any]):
    expected = (
        "no prompt",
        "0.6 to 9.8 seconds",
        "expected a whole number from 0 up",
        "takes 4",
        "learned 1 to 9",
    )
    for message, words in zip(answered["errors"], expected, strict=True):
        assert words in message


def test_a_model_of_labels_takes_them_in_node(student: Path, labels_folder: Path):
    if shutil.which("node") is None or not (PACKAGE / "node_modules").is_dir():
        pytest.skip("needs Node.js, and the package's dependencies: cd packages/web && npm ci")
    program = f"""
    import {{ load }} from "{PACKAGE}/src/node.js";
    const lm = await load("{labels_folder}");
    const {{ joints }} = await lm.generate("4", {{ seconds: 1, seed: 3, steps: 2, guidance: 2 }});
    const told = await lm.generate("9").catch(({{ name, message }}) => `${{name}}: ${{message}}`);
    console.log(JSON.stringify({{ joints: [...joints], told }}));
    await lm.close();
    """
    command = ["node", "--input-type=module", "-e", program]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    pipeline = MotionPipeline.from_pretrained(student, threads=1)
    expected = pipeline.batch(["4"], 1.0, [3], 2, 2.0)[0].joints
    found = np.reshape(answer["joints"], expected.shape)
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert answer["told"] == 'InputError: unknown action "9"; known are 0, 1, 2, 3, 4, 5'
