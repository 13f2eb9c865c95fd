"""ASF/AMC: poses worked out by hand, damage of every kind, real trials of CMU."""

from __future__ import annotations

import tarfile

import numpy as np
import pytest

from latentmotion import load
from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.rotations import matrix_from_euler
from latentmotion.kinematics.skeleton import HUMANML3D

# A leg: its femur's own x axis is the world's y.
ASF = """# a comment
:version 1.10
:name TEST
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
  none
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name femur
    direction 0 -2 0
    length 9
    axis 0 0 90 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
    id 2
    name tibia
    direction 0 -1 0
    length 4.5
    axis 0 0 0 XYZ
    dof rx
    limits (-10.0 170.0)
  end
:hierarchy
  begin
    root femur
    femur tibia
  end
"""

AMC = """#!OML:ASF X:\\somewhere
:FULLY-SPECIFIED
:DEGREES
7
root 0 9 0 0 0 0
femur 0 0 0
tibia 0
8
root 9 9 0 0 90 0
femur 90 0 0
tibia 90
"""

INCH = 0.0254 / 0.45


def put(tmp_path, asf=ASF, amc=AMC, names=("07.asf", "07_01.amc")):
    for name, content in zip(names, (asf, amc), strict=True):
        encoded = content.encode() if isinstance(content, str) else content
        if encoded is not None:
            (tmp_path / name).write_bytes(encoded)
    return tmp_path / names[1]


def test_positions_worked_out_by_hand(tmp_path):
    animation = read_asf_amc(put(tmp_path), fps=60)
    assert animation.skeleton.names == ("root", "femur", "tibia", "tibia_end")
    assert animation.skeleton.end_sites == (3,)
    assert animation.fps == 60
    rest = [[0, 9, 0], [0, 9, 0], [0, 0, 0], [0, -4.5, 0]]
    # Turning about the femur's own x turns about the world's y: together with the root's 90° the
    # knee's axis, x, becomes -x, and bending by 90° sends the shin to +z instead of -z.
    turned = [[9, 9, 0], [9, 9, 0], [9, 0, 0], [9, 0, 4.5]]
    np.testing.assert_allclose(animation.joints() / INCH, [rest, turned], atol=1e-9)


def test_radians_are_the_same_motion(tmp_path):
    expected = read_asf_amc(put(tmp_path)).joints()
    asf = ASF.replace("angle deg", "angle rad").replace("0 0 90 XYZ", f"0 0 {np.pi / 2} XYZ")
    amc = AMC.replace(" 90", f" {np.pi / 2}")
    for text in (amc.replace("DEGREES", "RADIANS"), amc.replace(":DEGREES\n", "")):
        np.testing.assert_allclose(read_asf_amc(put(tmp_path, asf, text)).joints(), expected)


def test_unit_of_length_is_read(tmp_path):
    inches = read_asf_amc(put(tmp_path, ASF.replace("length 0.45", "length 1.0")))
    assert inches.root_positions[0, 1] == pytest.approx(9 * 0.0254)
    assert -inches.skeleton.offsets[2, 1] == pytest.approx(9 * 0.0254)


def test_orders_of_angles_and_of_the_root(tmp_path):
    asf = ASF.replace("dof rx ry rz", "dof rz rx ry").replace("0 0 90 XYZ", "0 0 0 XYZ")
    asf = asf.replace("TX TY TZ RX RY RZ", "RY RX RZ TZ TX TY")
    asf = asf.replace("position 0 0 0", "position 0 0 5").replace("orientation 0", "orientation 30")
    amc = AMC.replace("root 0 9 0 0 0 0", "root 10 20 30 1 2 3")
    amc = amc.replace("femur 0 0 0", "femur 40 50 60")
    animation = read_asf_amc(put(tmp_path, asf, amc))
    femur = matrix_from_euler(np.deg2rad([60.0, 50, 40]), "YXZ")
    np.testing.assert_allclose(animation.rotations[0, 1], femur, atol=1e-12)
    axes = matrix_from_euler(np.deg2rad([30.0]), "X")
    root = axes @ matrix_from_euler(np.deg2rad([30.0, 20, 10]), "ZXY") @ axes.T
    np.testing.assert_allclose(animation.rotations[0, 0], root, atol=1e-12)
    np.testing.assert_allclose(animation.root_positions[0] / INCH, [2, 3, 6])


@pytest.mark.parametrize(
    ("asf", "amc"),
    [("07.asf", "07_01.amc"), ("HDM_bd.ASF", "HDM_bd_jog_120.amc"), ("a.asf", "b.amc")],
)
def test_skeleton_is_found_beside_the_motion(tmp_path, asf, amc):
    assert len(read_asf_amc(put(tmp_path, names=(asf, amc)))) == 2


def test_skeleton_of_the_longest_matching_name_wins(tmp_path):
    path = put(tmp_path, names=("HDM_bd.asf", "HDM_bd_jog.amc"))
    (tmp_path / "HDM.asf").write_text("broken")
    (tmp_path / "other.asf").write_text("broken")
    assert len(read_asf_amc(path)) == 2
    assert len(read_asf_amc(path, asf=tmp_path / "HDM_bd.asf")) == 2


def test_missing_skeleton(tmp_path):
    path = put(tmp_path)
    (tmp_path / "07.asf").unlink()
    with pytest.raises(FileFormatError, match=r"no ASF files.*07\.asf.*asf="):
        read_asf_amc(path)
    with pytest.raises(FileFormatError, match="No such file"):
        read_asf_amc(path, asf=tmp_path / "07.asf")
    for name in ("a.asf", "b.asf"):
        (tmp_path / name).write_text(ASF)
    with pytest.raises(FileFormatError, match="2 ASF files"):
        read_asf_amc(path)


@pytest.mark.parametrize("fps", [0, -1.0, float("nan")])
def test_impossible_frame_rate(tmp_path, fps):
    with pytest.raises(InputError, match="frame rate"):
        read_asf_amc(put(tmp_path), fps=fps)


DAMAGED_MOTION = {
    "empty": ("", None, "empty"),
    "binary": (b"\x00\x01", None, "binary"),
    "something else": ("hello\n", 1, "not AMC"),
    "no frames": (":DEGREES\n", 1, "no frames"),
    "only frame cut short": (AMC[: AMC.index("tibia")], 6, "before bone 'tibia'"),
    "last frame cut short": (AMC[: AMC.rindex("tibia")], 10, "truncated"),
    "line cut short": (AMC[: AMC.rindex("0 0\ntibia")], 10, "found 1 numbers.*expected 3"),
    "too many numbers": (AMC.replace("90 0 0\n", "90 0 0 0\n"), 10, "found 4 numbers"),
    "nan": (AMC.replace("tibia 90", "tibia nan"), 11, "'nan'"),
    "not a number": (AMC.replace("tibia 90", "tibia x"), 11, "'x'"),
    "unknown bone": (AMC.replace("tibia", "fibula"), 7, "'fibula'.*root, femur, tibia"),
    "unknown bone later": (AMC.replace("tibia 90", "fibula 90"), 11, "'fibula'"),
    "bone left out later": (AMC.replace("femur 90 0 0\n", ""), 10, "expected bone 'femur'"),
    "no frame number": (AMC.replace("8\nroot", "x\nroot"), 8, "'x'"),
    "no root": (AMC.replace("root 0 9 0 0 0 0\n", ""), 4, "without 'root'"),
}


DAMAGED_SKELETON = {
    "empty": ("", None, "empty"),
    "not ASF": ("hello", None, "no ':root' section"),
    "no hierarchy": (ASF[: ASF.index(":hierarchy")], None, "no ':hierarchy'"),
    "hierarchy cut short": (ASF[: ASF.rindex("end")], 39, "truncated"),
    "cut inside a bone": (ASF.replace("  end\n:h", ":h"), 34, "inside bone 'tibia'"),
    "bone without length": (ASF.replace("    length 9\n", ""), 25, "'femur' lacks"),
    "nan": (ASF.replace("length 9", "length nan"), 20, "'nan'"),
    "short direction": (ASF.replace("0 -2 0", "0 -2"), 19, "found 2 numbers"),
    "no order of axes": (ASF.replace("0 0 90 XYZ", "0 0 90"), 21, "order of axes"),
    "unknown channel": (ASF.replace("dof rx ry", "dof rx qq"), 22, "qq"),
    "unit of zero": (ASF.replace("length 0.45", "length 0"), 6, "unit of length"),
    "bone twice": (ASF.replace("name tibia", "name femur"), 35, "twice"),
    "unknown bone": (ASF.replace("femur tibia", "femur fibula"), 39, "'fibula'"),
    "circle": (ASF.replace("root femur", "tibia femur"), 38, "tree"),
}


DAMAGED = [("07_01.amc", *case) for case in DAMAGED_MOTION.values()]
DAMAGED += [("07.asf", *case) for case in DAMAGED_SKELETON.values()]


@pytest.mark.parametrize(
    ("file", "content", "line", "message"), DAMAGED, ids=[*DAMAGED_MOTION, *DAMAGED_SKELETON]
)
def test_damage_is_named_with_file_and_line(tmp_path, file, content, line, message):
    path = put(tmp_path, **{file[-3:]: content})
    with pytest.raises(FileFormatError, match=message) as error:
        read_asf_amc(path)
    assert (error.value.path.name, error.value.line) == (file, line)


def test_a_real_trial(shared, tmp_path):
    with tarfile.open(shared / "data" / "cmu_asfamc.tar.xz", "r|xz") as tar:
        for member in tar:
            if member.name.endswith(("131_03.amc", "131.asf")):
                content = tar.extractfile(member).read()
                (tmp_path / member.name.split("/")[-1]).write_bytes(content)
            if member.name.endswith("131.asf"):
                break
    animation = read_asf_amc(tmp_path / "131_03.amc")
    joints = to_humanml3d(animation)
    (motion,) = load(tmp_path / "131_03.amc")
    assert motion.fps == 120
    np.testing.assert_allclose(motion.joints, joints, atol=1e-6)
    lengths = np.linalg.norm(joints - joints[:, HUMANML3D.parents], axis=-1)[:, 1:]
    np.testing.assert_allclose(np.ptp(lengths[:, [3, 4, 6, 7]], axis=0), 0, atol=1e-9)
    # Thighs and shins come within a few centimeters of HumanML3D's own.
    canonical = np.linalg.norm(HUMANML3D.offsets, axis=-1)[1:]
    np.testing.assert_allclose(lengths[0, [3, 4, 6, 7]], canonical[[3, 4, 6, 7]], atol=0.06)
    # The person walks on the floor, the head well above it, the toes ahead of the heels.
    assert abs(np.median(joints[..., 1].min(axis=1))) < 0.15
    assert 1.2 < np.median(joints[:, 15, 1]) < 1.8
    across, up = joints[:, 1] - joints[:, 2], joints[:, 12] - joints[:, 0]
    ahead = np.cross(across, up)
    assert np.mean(np.sum(ahead * (joints[:, 10] - joints[:, 7]), axis=-1) > 0) > 0.95
