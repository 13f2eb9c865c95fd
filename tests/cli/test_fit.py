"""`latentmotion fit` and `edit --parts`: files in, files out; wrong ones explained."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cli.main import main
from latentmotion.kinematics.keypoints import LAYOUTS, joint_weights


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    monkeypatch.chdir(tmp_path)
    generate = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    joints = generate("a person walks forward", 1.5, 3, takes=1).joints
    points = np.einsum("kj,tjc->tkc", joint_weights(LAYOUTS["coco_17"]), joints)
    np.save("points.npy", points + np.random.default_rng(0).normal(0, 0.02, points.shape))
    Motion(joints).save("walk.npz")
    return joints


def test_keypoints_become_a_file(recorded: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["fit", "points.npy", "--fps", "20", "--layout", "coco_17"]
    main([*words, "--runtime", "onnxruntime", "-o", "out.npz"])
    printed = capsys.readouterr().out
    assert printed.startswith("noise ") and "wrote out.npz" in printed
    assert "joints moved" in printed.splitlines()[-1]
    motion = Motion.load("out.npz")
    assert len(motion) == 30
    assert np.linalg.norm(motion.joints - recorded, axis=-1).mean() < 0.1


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["fit", "points.npy"], "give it with --fps"),
        (["fit", "points.npy", "--fps", "20"], "coco_17 or h36m"),
        (["fit", "none.npy", "--fps", "20"], "there is no file none.npy"),
        (["fit", "walk.npz"], "holds a motion, not what a tracker saw"),
        (["fit", "points.npy", "--fps", "20", "-o", "out.xyz"], "'.xyz'"),
        (["fit", "points.npy", "--fps", "20", "--layout", "body_25"], "25 keypoints"),
        (["fit", "points.npy", "--fps", "20", "--runtime", "pytorch"], "onnxruntime or openvino"),
        (["edit", "walk.npz", "a", "--between", "0", "1", "--parts", "arm"], "--parts 'arm'"),
    ],
)
def test_wrong_input_is_explained(
    recorded: np.ndarray, capsys: pytest.CaptureFixture[str], words: list[str], reason: str
) -> None:
    with pytest.raises(SystemExit) as exit_code:
        main(words)
    assert exit_code.value.code == 2
    assert reason in capsys.readouterr().err
    assert not list(Path().glob("out*"))
