"""Results of trackers: the same walk, as each program saves its poses of SMPL."""

from __future__ import annotations

import pickle
import re
import warnings
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.errors import FileFormatError, LatentMotionError
from latentmotion.formats.smpl import PELVIS
from latentmotion.kinematics.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from latentmotion.kinematics.standing import Stated
from latentmotion.motion import Motion
from tests.support.bvh_kinds import walk

joblib = pytest.importorskip("joblib")
torch = pytest.importorskip("torch")
pytestmark = pytest.mark.filterwarnings("ignore:.*a guess:latentmotion.errors.ReadingWarning")

FRAMES = 40
# The world in the axes of a level camera: x right, y down, z ahead.
CAMERA = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Returns rotation vectors and translations of a walk, in the world and in a camera's axes."""
    path = tmp_path_factory.mktemp("smpl") / "a.smpl.npz"
    walk(FRAMES).save(path)
    arrays = dict(np.load(path))
    theta = np.concatenate([arrays["global_orient"], arrays["body_pose"]], axis=1)
    matrices = matrix_from_axis_angle(theta.reshape(FRAMES, 24, 3))
    seen = matrices.copy()
    seen[:, 0] = CAMERA @ seen[:, 0]
    away = CAMERA @ np.array([0.0, -1.0, -5.0])  # of the camera, a meter high, five meters away
    trans = (arrays["transl"] + PELVIS) @ CAMERA.T + away - PELVIS
    return {
        "theta": theta.astype("f4"),
        "trans": arrays["transl"].astype("f4"),
        "seen": seen.astype("f4"),
        "seen_theta": axis_angle_from_matrix(seen).reshape(FRAMES, 72).astype("f4"),
        "seen_trans": trans.astype("f4"),
        "away": away,
    }


def wham(path: Path, poses: dict[str, np.ndarray]) -> Path:
    results: dict[int, dict[str, np.ndarray]] = defaultdict(dict)
    for person, count in ((0, 2), (3, FRAMES)):  # the first is a glimpse of somebody else
        results[person] = {
            "pose": poses["seen_theta"][:count],
            "trans": poses["seen_trans"][:count],
            "pose_world": poses["theta"][:count],
            "trans_world": poses["trans"][:count],
            "betas": np.zeros((count, 10), "f4"),
            "verts": np.zeros((count, 60, 3), "f4"),
            "frame_ids": np.arange(7, 7 + count),
        }
    joblib.dump(results, path / "wham_output.pkl")
    return path / "wham_output.pkl"


def gvhmr(path: Path, poses: dict[str, np.ndarray]) -> Path:
    def tensors(theta: np.ndarray, trans: np.ndarray) -> dict[str, object]:
        return {
            "body_pose": torch.tensor(theta[:, 3:66]),
            "betas": torch.zeros(FRAMES, 10),
            "global_orient": torch.tensor(theta[:, :3]),
            "transl": torch.tensor(trans),
        }

    results = {
        "smpl_params_global": tensors(poses["theta"], poses["trans"]),
        "smpl_params_incam": tensors(poses["seen_theta"], poses["seen_trans"]),
        "K_fullimg": torch.eye(3).repeat(FRAMES, 1, 1),
        "net_outputs": {"model_output": {"pred_cam": torch.zeros(1, FRAMES, 3)}},
    }
    torch.save(results, path / "hmr4d_results.pt")
    return path / "hmr4d_results.pt"


def humans_4d(path: Path, poses: dict[str, np.ndarray]) -> Path:
    frames = {}
    for number in range(FRAMES):
        one = {
            "global_orient": poses["seen"][number, :1],
            "body_pose": poses["seen"][number, 1:],
            "betas": np.zeros(10, "f4"),
        }
        ghost = [] if number else [{**one, "global_orient": np.eye(3, dtype="f4")[None]}]
        frames[f"outputs/_DEMO/a/img/{number:06d}.jpg"] = {
            **{"time": number, "shot": 0, "tid": [*([4] if ghost else []), 1], "mask": []},
            **{"smpl": [*ghost, one], "camera": [np.array([0.0, 0, 60])] * 2, "tracked_ids": [1]},
        }
    joblib.dump(frames, path / "demo_a.pkl", compress=3)
    return path / "demo_a.pkl"


def romp(path: Path, poses: dict[str, np.ndarray]) -> Path:
    frames = {
        f"{number:08d}.png": {
            "smpl_thetas": poses["seen_theta"][number : number + 1],
            "cam_trans": poses["seen_trans"][number : number + 1],
            "track_ids": np.array([2], "i4"),
        }
        for number in range(FRAMES)
    }
    person: dict[str, list] = {"frame_id": list(range(FRAMES))}
    for frame in frames.values():
        for key in frame:
            person.setdefault(key, []).append(frame[key][0])
    save: Callable = np.savez
    save(path / "video_results.npz", results=frames, sequence_results={2: person})
    return path / "video_results.npz"


def romp_without_tracks(path: Path, poses: dict[str, np.ndarray]) -> Path:
    frames = {
        f"{n:08d}.png": {"smpl_thetas": poses["seen_theta"][n : n + 1]} for n in range(FRAMES)
    }
    save: Callable = np.savez
    save(path / "video_results.npz", results=frames, sequence_results={})
    return path / "video_results.npz"


def tram(path: Path, poses: dict[str, np.ndarray], camera: bool = True) -> Path:
    (path / "hps").mkdir()
    results = {
        "pred_cam": torch.zeros(FRAMES, 3),
        "pred_rotmat": torch.tensor(poses["seen"]),
        "pred_shape": torch.zeros(FRAMES, 10),
        "pred_trans": torch.tensor(poses["seen_trans"])[:, None],
        "frame": torch.arange(FRAMES),
    }
    np.save(path / "hps/hps_track_0.npy", np.array(results, object))
    if camera:
        turn = np.repeat(CAMERA.T[None], FRAMES, axis=0).astype("f4")
        place = np.repeat(-(CAMERA.T @ poses["away"])[None], FRAMES, axis=0).astype("f4")
        values = {"world_cam_R": turn, "world_cam_T": place, "img_focal": np.float64(1500)}
        np.save(path / "camera.npy", np.array(values, object))
    return path / "hps/hps_track_0.npy"


def tram_alone(path: Path, poses: dict[str, np.ndarray]) -> Path:
    return tram(path, poses, camera=False)


def vibe(path: Path, poses: dict[str, np.ndarray]) -> Path:
    keep = np.setdiff1d(np.arange(FRAMES), [11, 20])  # nobody was seen in two frames
    person = {"pose": poses["seen_theta"][keep], "betas": np.zeros((len(keep), 10))}
    joblib.dump({1: {**person, "frame_ids": keep}}, path / "vibe_output.pkl")
    return path / "vibe_output.pkl"


def aist(path: Path, poses: dict[str, np.ndarray]) -> Path:
    values = {"smpl_poses": poses["theta"], "smpl_scaling": np.array([93.0])}
    values["smpl_trans"] = 93.0 * poses["trans"]
    (path / "aist.pkl").write_bytes(pickle.dumps(values))
    return path / "aist.pkl"


TRACKERS: dict[str, Callable[[Path, dict[str, np.ndarray]], Path]] = {
    **{"WHAM": wham, "GVHMR": gvhmr, "4D-Humans": humans_4d, "ROMP": romp, "TRAM": tram},
    **{"ROMP, no tracks": romp_without_tracks, "TRAM, no camera": tram_alone},
    **{"VIBE": vibe, "AIST++": aist},
}
IN_THE_WORLD = ("WHAM", "GVHMR", "TRAM", "AIST++")


@pytest.mark.parametrize("tracker", TRACKERS)
def test_the_walk_is_read(tracker: str, poses: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = TRACKERS[tracker](tmp_path, poses)
    walk(FRAMES).save(tmp_path / "meant.smpl.npz")
    meant = Motion.load(tmp_path / "meant.smpl.npz").joints  # on the bones that poses are put on
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        (motion,) = formats.load(path)
    lines = [str(one.message) for one in told]
    assert motion.fps == 30 and any("30 frames per second (or --fps)" in line for line in lines)
    body = motion.joints - motion.joints[:, :1]
    np.testing.assert_allclose(body, meant - meant[:, :1], atol=0.02)
    if tracker in IN_THE_WORLD:
        np.testing.assert_allclose(motion.joints, meant, atol=1e-3)
    else:
        assert "the path is what keeps standing feet in place" in lines[-1]
        np.testing.assert_allclose(
            motion.joints[-1, 0], meant[-1, 0] - meant[0, 0] * (1, 0, 1), atol=0.1
        )
    assert motion.recorded is not None  # hands and head turn as the poses say


def test_the_rate_is_stated(
    poses: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = gvhmr(tmp_path, poses)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Motion.load(path, Stated(fps=25)).fps == 25
    main(["clean", str(path), "--fps", "20", "-o", str(tmp_path / "a.bvh")])
    assert "joints moved" in capsys.readouterr().out
    assert Motion.load(tmp_path / "a.bvh").fps == 20


class Bomb:
    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple:
        return Path.mkdir, (self.target,)


@pytest.mark.parametrize("ending", ["pkl", "npy", "pt"])
def test_code_is_named_and_not_run(ending: str, tmp_path: Path) -> None:
    path, bomb = tmp_path / f"a.{ending}", {"pose": Bomb(tmp_path / "run"), "betas": np.eye(3)}
    if ending == "pkl":
        joblib.dump(bomb, path)
    elif ending == "npy":
        np.save(path, np.array(bomb, object))
    else:
        torch.save(bomb, path)
    with pytest.raises(
        FileFormatError, match=r"holds (pathlib|builtins|__b)\S*, expected only arrays"
    ):
        formats.load(path)
    assert not (tmp_path / "run").exists()


def test_what_holds_no_poses_says_what_it_holds(tmp_path: Path) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"loss": 1.0, "epoch": 3}))
    with pytest.raises(FileFormatError, match=r"no poses of SMPL in it \(loss, epoch\)"):
        formats.load(tmp_path / "a.pkl")
    for wrong in (np.zeros((4, 70)), np.full((4, 72), np.nan), np.zeros((4, 24))):
        (tmp_path / "a.pkl").write_bytes(pickle.dumps({"pose_world": wrong}))
        with pytest.raises(FileFormatError, match="no results of SMPL"):
            formats.load(tmp_path / "a.pkl")


@pytest.mark.parametrize("tracker", ["WHAM", "GVHMR", "4D-Humans", "TRAM"])
def test_damage_is_an_error_of_the_file(
    tracker: str, poses: dict[str, np.ndarray], tmp_path: Path
) -> None:
    path = TRACKERS[tracker](tmp_path, poses)
    whole, generator = path.read_bytes(), np.random.default_rng(0)
    for number in range(60):
        damaged = bytearray(whole if number % 2 else whole[: int(generator.integers(len(whole)))])
        for place in generator.integers(max(len(damaged), 1), size=3):
            if damaged:
                damaged[min(place, 4000, len(damaged) - 1)] = int(generator.integers(256))
        path.write_bytes(damaged)
        try:
            formats.load(path)
        except Exception as error:
            assert isinstance(error, LatentMotionError), error
            assert re.search(r"wham|hmr4d|demo|hps", str(error))
