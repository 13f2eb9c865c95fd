"""A motion on a robot: the angles of its hinges, within their limits, and its root.

The legs' lengths scale the body. Relative to the pelvis, whose frame the root has, the angles q of
every frame minimize by Gauss-Newton steps, each clipped to the limits (a hinge at a limit that
would leave it is held):

    |ankle − scaled ankle|² + |thigh's direction|² + |upper arm's, forearm's directions|²
      + |chest's and feet's axes|² + ε |q|² + σ |q − its neighbors in time|²

The root follows the hips; its height puts the lower sole as far above the floor as the person's is.
Axes of the result are z up, x ahead at the start, as robots have them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.errors import InputError
from latentmotion.formats import numbered
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.rotations import continuous_quaternions, quaternion_from_matrix
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion
from latentmotion.robots.description import Robot
from latentmotion.storage.files import atomic_file

ENDINGS = (".csv", ".npz")  # Files that motions of robots are written to.

# Gauss-Newton steps, and radians of one that is the last.
_STEPS, _STILL = 6, 0.003

# Radians by which knees and elbows are bent at first, as a straight one has no direction to go.
_BENT = 0.3

# Weights of meters of ankles, thighs and arms, of axes, and of level soles.
_ANKLE, _THIGH, _ARM, _AXIS, _LEVEL = 4.0, 0.4, 1.0, 0.4, 0.3

# √ε and √σ.
_ZERO, _SMOOTH = 0.02, 0.15

# Meters above the lowest point up to which a foot's points are its sole, and how many are kept.
_BAND, _DIRECTIONS = 0.03, 16


# Parts whose hinges are solved for, beside the waist; all others stay at zero.
_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow")


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """A robot moving: z up, the floor at height 0."""

    robot: Robot  # The robot.
    positions: Float[np.ndarray, "frames 3"]  # Positions of its root, meters.
    rotations: Float[np.ndarray, "frames 4"]  # Rotations of its root, quaternions w, x, y, z.
    # Angles of its hinges, radians, in the order of the file.
    angles: Float[np.ndarray, "frames hinges"]
    fps: float  # Frames per second.
    missed: float  # Meters by which ankles miss their places, on average.

    @property
    def qpos(self) -> Float[np.ndarray, "frames values"]:
        """Root and hinges as MuJoCo orders them."""
        return np.concatenate([self.positions, self.rotations, self.angles], axis=1)

    @property
    def violations(self) -> int:
        """How many angles are beyond their limits."""
        low, high = self.robot.limits.T
        return int(((self.angles < low) | (self.angles > high)).sum())

    @property
    def fastest(self) -> float:
        """The fastest hinge, radians per second."""
        return float(np.abs(np.diff(self.angles, axis=0)).max(initial=0)) * self.fps


def retarget(motion: Motion, robot: Robot) -> RobotMotion:
    """Retargets a motion to a robot.

    Args:
        motion: The motion; its floor at height 0.
        robot: The robot.

    Raises:
        DataError: The joints of the motion are unknown.
    """
    ours = motion.skeleton.names == HUMANML3D.names
    joints = motion.joints if ours else to_humanml3d(motion.animation())
    return _body(robot).solved(joints.astype(float)[..., [2, 0, 1]], motion.fps)


def write(path: str | Path, motions: Sequence[RobotMotion]) -> list[Path]:
    """Writes a file for each motion.

    Args:
        path: `.csv`: rows of root position, root quaternion (w, x, y, z) and angles, no header, as
            MuJoCo's qpos, Kimodo and ProtoMotions have them. `.npz`: the same as `qpos` and `fps`,
            as Holosoma reads them, and by GMR's names `root_pos`, `root_rot` (x, y, z, w) and
            `dof_pos`, with `joint_names`.
        motions: At least one.

    Raises:
        InputError: Another ending, or the folder cannot be written.
    """
    target = Path(path)
    check_output(target)
    paths = numbered(target, len(motions))
    for output, moving in zip(paths, motions, strict=True):
        with atomic_file(output) as temporary:
            if output.suffix.lower() == ".csv":
                np.savetxt(temporary, moving.qpos, "%.6f", ",")
                continue
            with temporary.open("wb") as file:
                np.savez(
                    file,
                    qpos=moving.qpos,
                    fps=moving.fps,
                    root_pos=moving.positions,
                    root_rot=moving.rotations[:, [1, 2, 3, 0]],
                    dof_pos=moving.angles,
                    joint_names=np.array(moving.robot.hinges),
                )
    return paths


def check_output(path: Path) -> None:
    """Raises InputError where motions of robots are not written to files of this ending."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"cannot write {path}: motions of robots are .csv or .npz")


class _Body:
    """What the solver needs of a robot: its landmarks and which hinges move them."""

    def __init__(self, robot: Robot) -> None:
        self.robot, links, parts = robot, robot.links, robot.parts
        turned = [parts[f"{side}_{part}"] for side in SIDES for part in _JOINTS]
        active = sorted({*sum(turned, ()), *parts.get("waist", ())})
        self.column = [robot.moving.index(link) for link in active]
        self.low, self.high = robot.limits[self.column].T
        feet = {parts[f"{side}_ankle"][-1] for side in SIDES}
        wrists = {link for side in SIDES for link in parts.get(f"{side}_wrist", ())[:1]}
        below = [n for n in range(len(links)) if feet & set(robot.line(n))]
        # Other links follow these and need not be computed.
        needed = sorted({link for n in (*active, *wrists, *below) for link in robot.line(n)})
        self.number = {link: n for n, link in enumerate(needed)}
        self.active = np.array([self.number[link] for link in active])
        lines = [robot.line(link) for link in needed]
        self.moves = np.array([[a in line for a in active] for line in lines], float)
        self.levels: list[list[int]] = [[] for _ in range(max(map(len, lines)))]
        for number, line in enumerate(lines):
            self.levels[len(line) - 1].append(number)
        self.links = [links[link] for link in needed]
        self.parents = np.array([self.number.get(link.parent, -1) for link in self.links])
        self.bases = np.array([link.rotation for link in self.links])
        self.anchors = np.array([link.anchor for link in self.links])
        self.axes = np.array([link.axis for link in self.links])
        x, y, z = self.axes.T
        zero = np.zeros_like(x)
        skew = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
        self.by_sine, self.by_cosine = self.bases @ skew, self.bases @ skew @ skew
        offsets = np.array([link.offset for link in self.links])
        self.shifts = offsets + (self.bases @ self.anchors[..., None])[..., 0]
        self.rest = self.forward(np.zeros((1, len(active))))
        self._find_landmarks()

    def _find_landmarks(self) -> None:
        parts, self.points = self.robot.parts, dict[str, tuple[int, np.ndarray]]()
        for side in SIDES:
            for part in _JOINTS:
                hinges = parts[f"{side}_{part}"]
                # Hinges of hips and shoulders nearly meet in the middle one.
                middle = len(hinges) // 2 if part in ("hip", "shoulder") else 0
                link = self.number[hinges[middle]]
                self.points[f"{side}_{part}"] = (link, self.links[link].anchor)
            last = self.number[(*parts[f"{side}_elbow"], *parts.get(f"{side}_wrist", ())[:1])[-1]]
            tip = self.links[last]
            local = tip.anchor if f"{side}_wrist" in parts else tip.center
            self.points[f"{side}_wrist"] = (last, local)
        place = {name: self.place(self.rest, name)[0] for name in self.points}
        left = place["left_hip"] - place["right_hip"]
        down = np.sum([place[f"{side}_ankle"] - place[f"{side}_hip"] for side in SIDES], axis=0)
        nearest = [np.eye(3)[i] * np.sign(v[i]) for v in (left, -down) for i in [abs(v).argmax()]]
        self.base = np.stack([np.cross(*nearest), *nearest], axis=1)  # ahead, left, up
        self.hips = (place["left_hip"] + place["right_hip"]) / 2
        self.chest = int(self.parents[self.number[parts["left_shoulder"][0]]])
        self.feet = [self.number[parts[f"{side}_ankle"][-1]] for side in SIDES]
        bent = {parts[f"{side}_{part}"][0] for side in SIDES for part in ("knee", "elbow")}
        bent = [self.number[link] for link in bent]
        self.bends = [n for n, link in enumerate(self.active) if link in bent]
        self.soles = [self._sole(parts[f"{side}_ankle"][-1]) for side in SIDES]
        self.length = {
            (a, b): float(np.linalg.norm(place[b] - place[a]))
            for side in SIDES
            for limb in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
            for a, b in pairwise(f"{side}_{part}" for part in limb)
        }
        self.bones = [pair for pair in self.length if "ankle" not in pair[1]]  # whose ways count

    def _sole(self, foot: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns links and points of a foot's sole: outermost of the lowest ones."""
        rotations, positions = self.rest
        below = [n for link, n in self.number.items() if foot in self.robot.line(link)]
        links = np.concatenate([[n] * (1 + len(self.links[n].points)) for n in below])
        points = [np.concatenate([np.zeros((1, 3)), self.links[n].points]) for n in below]
        local = np.concatenate(points)
        world = positions[0, links] + np.einsum("pab,pb->pa", rotations[0, links], local)
        world = world @ self.base
        lowest = np.flatnonzero(world[:, 2] < world[:, 2].min() + _BAND)
        angles = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
        ways = np.stack([np.cos(angles), np.sin(angles), np.full(_DIRECTIONS, -1.0)])
        outline = lowest[np.unique((world[lowest] @ ways).argmax(axis=0))]
        return links[outline], local[outline]

    def forward(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns rotations and positions of all links relative to the root, (frames, links, …)."""
        rotations, positions = self._forward(q.T)
        return rotations.transpose(3, 0, 1, 2), positions.transpose(2, 0, 1)

    def _forward(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns them with frames last, where NumPy multiplies many small matrices at once."""
        angles = np.zeros((len(self.parents), q.shape[1]))
        angles[self.active] = q
        sine, cosine = np.sin(angles)[:, None, None], 1 - np.cos(angles)[:, None, None]
        local = self.bases[..., None] + sine * self.by_sine[..., None]
        local += cosine * self.by_cosine[..., None]
        shifts = self.shifts[..., None] - _turned(local, self.anchors)
        rotations, positions = local, shifts
        for level in self.levels[1:]:
            parents = self.parents[level]
            above = rotations[parents]
            positions[level] = positions[parents] + (above * shifts[level][:, None]).sum(2)
            rotations[level] = np.einsum("labt,lbct->lact", above, local[level])
        return rotations, positions

    def place(self, pose: tuple[np.ndarray, np.ndarray], name: str) -> np.ndarray:
        """Returns the positions of a landmark relative to the root."""
        link, local = self.points[name]
        return pose[1][:, link] + pose[0][:, link] @ local

    @cached_property
    def vectors(self) -> list[tuple[int, np.ndarray]]:
        """Links and their local vectors: chest ahead and left, then each foot ahead and left."""
        axes = [(self.chest, 0), (self.chest, 1)]
        axes += [(foot, axis) for axis in (0, 1) for foot in self.feet]
        return [(link, self.rest[0][0, link].T @ self.base[:, axis]) for link, axis in axes]

    def solved(self, joints: Float[np.ndarray, "frames 22 3"], fps: float) -> RobotMotion:
        """Returns the angles and the root for the joints of a person, z up."""
        at = {name: joints[:, number] for number, name in enumerate(HUMANML3D.names)}
        bones = [
            np.linalg.norm(at[f"{side}_{a}"] - at[f"{side}_{b}"], axis=-1)
            for side in SIDES
            for a, b in (("hip", "knee"), ("knee", "ankle"))
        ]
        legs = [v for (name, _), v in self.length.items() if "hip" in name or "knee" in name]
        scale = sum(legs) / float(np.median(bones, axis=1).sum())
        pelvis = _frame(at["left_hip"] - at["right_hip"], at["spine2"] - at["pelvis"])
        chest = _frame(at["left_shoulder"] - at["right_shoulder"], at["neck"] - at["spine2"])
        turn = self.base @ np.swapaxes(pelvis, -1, -2)  # the world → the root

        def inside(vectors: np.ndarray) -> np.ndarray:
            return (turn @ vectors[..., None])[..., 0]

        middle = (at["left_hip"] + at["right_hip"]) / 2
        ankles = [self.hips + scale * inside(at[f"{side}_ankle"] - middle) for side in SIDES]
        bones = [self.length[a, b] * inside(unit(at[b] - at[a])) for a, b in self.bones]
        ahead, clearance = _feet(at, pelvis[..., 0])
        axes = [inside(chest[..., 0]), inside(chest[..., 1]), *map(inside, ahead)]
        angles, missed = self._angles([*ankles, *bones, *axes], turn[..., 2])
        rotations = np.swapaxes(turn, -1, -2)
        positions = scale * middle - rotations @ self.hips
        pose = self.forward(angles)
        heights = []
        for links, local in self.soles:
            places = pose[1][:, links] + np.einsum("tpab,pb->tpa", pose[0][:, links], local)
            heights.append(np.einsum("ta,tpa->tp", rotations[:, 2], places).min(axis=1))
        positions[:, 2] = scale * clearance - np.min(heights, axis=0)
        every = np.clip(np.zeros((len(joints), len(self.robot.moving))), *self.robot.limits.T)
        every[:, self.column] = angles
        quaternions = continuous_quaternions(quaternion_from_matrix(rotations))
        return RobotMotion(self.robot, positions, quaternions, every, fps, missed)

    @cached_property
    def compared(self) -> Float[np.ndarray, "rows marks"]:
        """Weights of points and, after them, vectors in what is compared: ankles, bones, axes."""
        names = list(self.points)
        compared = np.zeros((2 + len(self.bones) + 4, len(names) + len(self.vectors)))
        for row, side in enumerate(SIDES):
            compared[row, names.index(f"{side}_ankle")] = _ANKLE
        for row, (begin, end) in enumerate(self.bones, 2):
            weight = _THIGH if "knee" in end else _ARM
            compared[row, [names.index(begin), names.index(end)]] = -weight, weight
        compared[-4:, len(names) : len(names) + 4] = _AXIS * np.eye(4)
        return compared

    def _angles(
        self, targets: list[np.ndarray], up: Float[np.ndarray, "frames 3"]
    ) -> tuple[Float[np.ndarray, "frames hinges"], float]:
        """Returns the angles that bring what is compared to its targets, and the ankles' miss."""
        marks, compared = [*self.points.values(), *self.vectors], self.compared
        links, local = np.array([link for link, _ in marks]), np.array([at for _, at in marks])
        is_point = (np.arange(len(marks)) < len(self.points))[:, None].astype(float)
        scales = np.abs(compared).max(axis=1)
        goal = np.stack([k * target.T for k, target in zip(scales, targets, strict=True)])
        # Only a few hinges move each row: its share of a row's slope is computed for those.
        level = np.zeros((2, len(marks)))
        level[:, -2:] = _LEVEL * np.eye(2)
        shares = np.concatenate([compared, level]) * self.moves[links].T[:, None]
        hinges, rows = np.nonzero(shares.any(axis=-1))
        shares = shares[hinges, rows]
        points, plain = (shares @ is_point)[..., None], rows < len(compared)
        ahead = rows[plain]
        q = np.tile(np.clip(np.zeros(len(self.active)), self.low, self.high), (len(up), 1))
        further = np.where(-self.low > self.high, -_BENT, _BENT)
        q[:, self.bends] = np.clip(further, self.low, self.high)[self.bends]
        up, error = up.T, np.zeros((2, 3, len(up)))
        for _ in range(_STEPS):
            rotations, positions = self._forward(q.T)
            axis = _turned(rotations[self.active], self.axes[self.active])
            anchor = _turned(rotations[self.active], self.anchors[self.active])
            anchor += positions[self.active]
            now = _turned(rotations[links], local) + positions[links] * is_point[..., None]
            # What a turn about an axis a does to p is a × (p − anchor).
            arm = (shares @ now.reshape(len(marks), -1)).reshape(len(shares), 3, -1)
            arm -= points * anchor[hinges]
            slope = np.cross(axis[hinges], arm, axis=1)
            columns = np.zeros((len(q), q.shape[1], 3 * len(compared) + 2))
            columns.T[3 * ahead[:, None] + np.arange(3), hinges[plain, None]] = slope[plain]
            levels = (slope[~plain] * up).sum(1)
            columns.T[2 * len(compared) + rows[~plain], hinges[~plain]] = levels
            gap = (compared @ now.reshape(len(marks), -1)).reshape(goal.shape) - goal
            error = gap[:2] / _ANKLE
            level = _LEVEL * (now[-2:] * up).sum(1)
            residual = np.concatenate([gap.reshape(-1, len(q)), level]).T
            matrix = columns @ np.swapaxes(columns, 1, 2)
            # From the first step on, so that neighbors bend the same way where there are two.
            padded = np.concatenate([q[:1], q, q[-1:]])
            gradient = (columns @ residual[..., None])[..., 0] + _ZERO**2 * q
            gradient += _SMOOTH**2 * (q - (padded[:-2] + padded[2:]) / 2)
            held = ((q <= self.low) & (gradient > 0)) | ((q >= self.high) & (gradient < 0))
            matrix[held] = 0
            matrix.swapaxes(1, 2)[held] = 0
            diagonal = np.arange(q.shape[1])
            matrix[:, diagonal, diagonal] += _ZERO**2 + _SMOOTH**2 + held
            moved = np.linalg.solve(matrix, np.where(held, 0, gradient)[..., None])[..., 0]
            before, q = q, np.clip(q - np.clip(moved, -1, 1), self.low, self.high)
            if np.abs(q - before).max() < _STILL:
                break
        return q, float(np.linalg.norm(error, axis=1).mean())


_body = lru_cache(8)(_Body)


def _turned(rotations: np.ndarray, vectors: np.ndarray) -> Float[np.ndarray, "links 3 frames"]:
    """Returns a vector of each link in the frame of the rotations (links, 3, 3, frames)."""
    return (rotations * vectors[:, None, :, None]).sum(axis=2)


def _frame(left: np.ndarray, up: np.ndarray) -> Float[np.ndarray, "frames 3 3"]:
    """Returns axes ahead, to the left and up, as columns."""
    left = unit(left)
    ahead = unit(np.cross(left, up))
    return np.stack([ahead, left, np.cross(ahead, left)], axis=-1)


def _feet(
    at: dict[str, np.ndarray], ahead: Float[np.ndarray, "frames 3"]
) -> tuple[list[np.ndarray], Float[np.ndarray, " frames"]]:
    """Returns where the feet point, level where they stand flat, and the lower one's clearance."""
    directions, lowest = [], []
    for side in SIDES:
        toe, ankle = at[f"{side}_foot"], at[f"{side}_ankle"]
        foot = toe - ankle
        flat = ankle[:, 2] <= np.quantile(ankle[:, 2], 0.3)
        level = unit((foot + 0.02 * ahead) * (1, 1, 0))
        pitch = np.arctan2(foot[:, 2], np.linalg.norm(foot[:, :2], axis=-1))
        pitch = pitch - np.clip(np.median(pitch[flat]), -0.9, 0)
        directions.append(np.cos(pitch)[:, None] * level + np.sin(pitch)[:, None] * (0, 0, 1))
        lowest += [toe[:, 2], ankle[:, 2] + np.median(foot[flat, 2])]
    heights = np.min(lowest, axis=0)
    return directions, np.maximum(heights - np.quantile(heights, 0.05), 0)
