"""MMCP: the pipeline as a server of the Motion Model Context Protocol (motionmcp-sdk).

Prompts, root paths, effector targets and pose keyframes in, glTF out. A request on another skeleton
than ours is answered on that one; its goals are scaled by the legs. All is meters, y up; a motion
without a path begins above the origin, facing +z.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import motionmcp
import numpy as np
from fastapi import FastAPI
from jaxtyping import Float
from motionmcp import Backbone, GenerateRequest, ModelSpec, MotionResult, ProtocolError, schemas
from motionmcp.backbone import Limits
from starlette.middleware.trustedhost import TrustedHostMiddleware

from latentmotion.cleanup import USUAL
from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.control.goals import Goal, Heading, Reach, RootPath
from latentmotion.control.stream import generate_loop
from latentmotion.control.timeline import LONGEST, Span, generate_timeline
from latentmotion.errors import LatentMotionError
from latentmotion.kinematics.humanoid import Humanoid, find_humanoid
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, Animation, Joints, Skeleton
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.retarget.rig import Rig, make_rig
from latentmotion.retarget.rig_files import RigFile
from latentmotion.retarget.transfer import retarget


@dataclass(frozen=True, eq=False)
class RequestedRig(RigFile):
    """The skeleton of a request, as `make_rig` reads rig files."""

    skeleton: Skeleton  # Its joints; offsets in the world's axes at rest.
    rest: Float[np.ndarray, "joints 3 3"]  # Rotations of its joints in the world at rest.
    root: Float[np.ndarray, " 3"]  # Rest position of the root, meters.

    path, unit, movable, endings = Path("the request's skeleton"), 1.0, frozenset({0}), ()

    def write(
        self, path: Path, animations: Sequence[Animation], names: Sequence[str]
    ) -> list[Path]:
        """Writes nothing: the answer is made by the protocol."""
        raise NotImplementedError

    @classmethod
    def of(cls, skeleton: schemas.Skeleton) -> RequestedRig:
        """Reads the joints of a request."""
        names = [joint.name for joint in skeleton.joints]
        parents = [-1 if j.parent is None else names.index(j.parent) for j in skeleton.joints]
        rest, offsets = np.empty((len(names), 3, 3)), np.zeros((len(names), 3))
        for number, (joint, parent) in enumerate(zip(skeleton.joints, parents, strict=True)):
            above = np.eye(3) if parent < 0 else rest[parent]
            rest[number] = above @ _matrix(joint.rest_rotation)
            offsets[number] = above @ np.asarray(joint.rest_translation, float)
        root, offsets[0] = offsets[0].copy(), 0
        return cls(Skeleton("request", tuple(names), tuple(parents), offsets), rest, root)

    def local(self, animation: Animation) -> tuple[Float[np.ndarray, "frames joints 4"], Joints]:
        """Returns rotations (x, y, z, w) and translations relative to the parents, as glTF has."""
        world = animation.skeleton.world_rotations(animation.rotations) @ self.rest
        parents = list(self.skeleton.parents)
        above = world[:, parents]
        above[:, 0] = np.eye(3)
        places = animation.joints()
        steps = places - places[:, parents]
        steps[:, 0] = places[:, 0]
        turned = quaternion_from_matrix(np.swapaxes(above, -1, -2) @ world)
        return turned[..., [1, 2, 3, 0]], np.einsum("tjab,tja->tjb", above, steps)


def _matrix(quaternion: Sequence[float]) -> Float[np.ndarray, "3 3"]:
    x, y, z, w = quaternion
    length = np.linalg.norm(quaternion)
    if not length > 1e-6:
        raise ProtocolError("schema_validation", "a rotation of length zero; expected x, y, z, w")
    return matrix_from_quaternion(np.array([w, x, y, z]) / length)


@dataclass(frozen=True, eq=False)
class TargetFigure:
    """What a request is answered on: a skeleton, its joints by our names, and its size."""

    file: RequestedRig  # The skeleton.
    body: Humanoid  # Its joints by our names.
    rig: Rig | None  # To retarget to; None for our own skeleton.

    @classmethod
    @lru_cache(maxsize=16)  # a program asks for its character again and again
    def of(cls, skeleton: str) -> TargetFigure:
        """Finds the joints of a request's skeleton, in JSON.

        Raises:
            DataError: Its joints are unknown.
        """
        file = RequestedRig.of(schemas.Skeleton.model_validate_json(skeleton))
        if file.skeleton.names == HUMANML3D.names:
            return cls(file, find_humanoid(HUMANML3D), None)
        body = find_humanoid(file.skeleton)
        return cls(file, body, make_rig(file, body))

    @cached_property
    def scale(self) -> float:
        """Its legs by ours."""
        return self.rig.leg / _OUR_LEG if self.rig else 1.0

    def ours(self, name: str) -> str | None:
        """Returns our name of a joint, None where it plays no part."""
        index = self.file.skeleton.names.index(name)
        return next((ours for ours, joint in self.body.joints.items() if joint == index), None)

    def result(self, motions: Sequence[Motion], fps: float, frames: int) -> MotionResult:
        """Returns motions on the skeleton, each of so many frames."""
        rotations, places, contacts = [], [], []
        for motion in motions:
            motion = motion.resampled(fps)
            if self.rig is None:
                animation = motion.animation()
            else:
                animation = self.rig.in_file(retarget(motion, self.rig))
            turned, moved = self.file.local(animation)
            shown = np.minimum(np.arange(frames), len(motion) - 1)
            rotations.append(turned[shown])
            places.append(moved[shown])
            contacts.append(foot_contacts(motion.joints, fps, motion.skeleton)[shown])
        feet = [*HUMANML3D.left_foot, *HUMANML3D.right_foot]
        names = {HUMANML3D.names[joint]: column for column, joint in enumerate(feet)}
        stands = {
            self.file.skeleton.names[self.body.joints[name]]: np.stack(contacts)[..., column]
            for name, column in names.items()
            if name in self.body.joints
        }
        moved = np.stack(places)
        return MotionResult(
            np.stack(rotations),
            moved[:, :, 0],
            translations=moved,
            foot_contacts=stands,
            trajectories=[None] * len(motions) if frames == 1 else None,  # a pose has no path
        )


# Thigh and shank of the canonical skeleton, meters.
_OUR_LEG = float(np.linalg.norm(BODY.offsets[[4, 7]], axis=-1).sum())


class LatentMotionBackbone(Backbone):
    """A model behind MMCP."""

    def __init__(self, pipeline: MotionPipeline) -> None:
        self.pipeline = pipeline
        self.model_id = f"latentmotion-{pipeline.card.name}"

    def setup(self) -> None:
        """Generates once, so that the first request need not wait for the networks."""
        self.pipeline("a person walks", seconds=2)

    def capabilities(self) -> ModelSpec:
        """Returns what the model takes and makes."""
        standing = -BODY.rest_joints()[:, 1].min()
        offsets = [(0.0, standing, 0.0), *BODY.offsets[1 : len(HUMANML3D)]]
        joints = [
            {
                "name": name,
                "parent": None if parent < 0 else HUMANML3D.names[parent],
                "rest_translation": tuple(map(float, offset)),
                "rest_rotation": (0.0, 0.0, 0.0, 1.0),
            }
            for name, parent, offset in zip(
                HUMANML3D.names, HUMANML3D.parents, offsets, strict=True
            )
        ]
        feet = [HUMANML3D.names[j] for j in (*HUMANML3D.left_foot, *HUMANML3D.right_foot)]
        return ModelSpec(
            id=self.model_id,
            fps=self.pipeline.representation.fps,
            canonical_skeleton=schemas.Skeleton.model_validate({"joints": joints}),
            supports_retargeting=True,
            supports_joint_translation=True,
            supports_loop=True,
            supported_constraints=["root_path", "effector_target", "pose_keyframe"],
            supported_segments=["text", "unconditioned", "pose"],
            supported_guidance_types=["nocfg", "regular"],
            predicted_contact_joints=feet,
            model_options=[_TAKES],
            chunking="stitched",
            limits=Limits.model_validate({"max_duration_seconds": min(LONGEST, 60.0)}),
        )

    def generate(self, request: GenerateRequest) -> MotionResult:
        """Answers a request.

        Raises:
            ProtocolError: A goal cannot be met or the skeleton's joints are unknown.
        """
        try:
            with warnings.catch_warnings(record=True) as doubts:
                warnings.simplefilter("always")
                stage = TargetFigure.of(request.skeleton.model_dump_json())
                options = request.options or _OPTIONS
                first = 0 if options.seed is None else options.seed
                fps = request.fps(self.pipeline.representation.fps)
                seeds = range(first, first + options.num_samples)
                motions = [self._motion(request, stage, seed, fps) for seed in seeds]
                result = stage.result(motions, fps, request.total_frames)
        except LatentMotionError as error:
            raise ProtocolError("invalid_options", str(error)) from error
        texts = dict.fromkeys(str(doubt.message) for doubt in doubts)
        result.notes = [{"code": "doubt", "severity": "info", "message": t} for t in texts]
        return result

    def _motion(
        self, request: GenerateRequest, stage: TargetFigure, seed: int, fps: float
    ) -> Motion:
        options = request.options or _OPTIONS
        weights = options.guidance.weight if options.guidance else None
        guidance = weights[0] if weights else None
        prompts = [getattr(segment, "prompt", _ANYTHING) for segment in request.segments]
        prompt, seconds = ", then ".join(prompts) or _ANYTHING, request.total_frames / fps
        takes = (options.model_options or {}).get(_TAKES.name)
        steps = USUAL if options.post_processing else None
        if options.loop:
            return generate_loop(self.pipeline, prompt, seconds, seed, guidance=guidance)
        goals = self._goals(request, stage, seed, fps)
        if len(prompts) > 1 and not goals:
            lengths = [segment.duration_frames / fps for segment in request.segments]
            spans = [Span(*span) for span in zip(prompts, lengths, strict=True)]
            motion = generate_timeline(self.pipeline, spans, seed, guidance=guidance)
            return motion.cleaned(steps) if steps else motion
        if any(segment.type == "pose" for segment in request.segments):
            return self.pipeline(prompt, seed=seed, guidance=guidance, takes=takes).cut(*_POSE)
        seconds = max(seconds, self.pipeline.card.frames[0] / self.pipeline.representation.fps)
        return self.pipeline(
            prompt, seconds, seed, guidance=guidance, goals=goals, takes=takes, clean_up=steps
        )

    def _goals(
        self, request: GenerateRequest, stage: TargetFigure, seed: int, fps: float
    ) -> list[Goal]:
        """Returns constraints as goals, in the size of our own body."""
        goals: list[Goal] = []
        for constraint in request.constraints:
            if isinstance(constraint, schemas.RootPathConstraint):
                times = [frame / fps for frame in constraint.frames]
                points = [(x / stage.scale, z / stage.scale) for x, z in constraint.positions_xz]
                apart = np.linalg.norm(np.diff(points, axis=0), axis=-1) if points[1:] else [0.0]
                angles = zip(times, constraint.heading_radians or (), strict=False)
                turns = [Heading(at, float(np.degrees(angle))) for at, angle in angles]
                if constraint.frames[0] == 0 and min(apart) > 1e-3:  # it begins at the start
                    goals += [RootPath(points, times), *turns]
                else:
                    places = zip(times, points, strict=True)
                    reaches = [Reach("pelvis", at, (x, None, z)) for at, (x, z) in places]
                    goals += [*turns, *reaches]
            elif isinstance(constraint, schemas.EffectorTargetConstraint):
                name = stage.ours(constraint.joint)
                if name is None:
                    raise ProtocolError(
                        "unknown_joint", f"{constraint.joint!r} has no counterpart in our skeleton"
                    )
                for frame, (x, y, z) in zip(constraint.frames, constraint.positions, strict=True):
                    place = (x / stage.scale, y / stage.scale, z / stage.scale)
                    goals.append(Reach(name, frame / fps, place))
            elif isinstance(constraint, schemas.PoseKeyframeConstraint):
                goals += self._pose(constraint, request, stage, seed, fps)
        return goals

    def _pose(
        self,
        key: schemas.PoseKeyframeConstraint,
        request: GenerateRequest,
        stage: TargetFigure,
        seed: int,
        fps: float,
    ) -> list[Reach]:
        """Returns the places of the joints of a pose that its rotations determine."""
        file = stage.file
        names, parents = file.skeleton.names, file.skeleton.parents
        world, place = file.rest.copy(), np.zeros((len(names), 3))
        determined = np.ones(len(names), bool)
        for joint, (name, parent) in enumerate(zip(names, parents, strict=True)):
            above = np.eye(3) if parent < 0 else world[parent]
            rest = file.rest[joint] if parent < 0 else file.rest[parent].T @ file.rest[joint]
            turned = key.joint_rotations.get(name)
            world[joint] = above @ (rest if turned is None else _matrix(turned))
            if parent >= 0:
                step = file.rest[parent].T @ file.skeleton.offsets[joint]
                place[joint] = place[parent] + above @ step
                fills = key.fill_mode == "rest" or names[parent] in key.joint_rotations
                determined[joint] = determined[parent] and fills
        if key.root_position is not None:
            place += np.asarray(key.root_position, float)
        else:  # where the motion would be without the pose, its lowest joint on the floor
            others = [item for item in request.constraints if item.type != "pose_keyframe"]
            free = request.model_copy(update={"constraints": others})
            motion = self._motion(free, stage, seed, fps).resampled(fps)
            pelvis = stage.scale * motion.joints[min(key.frame, len(motion) - 1), 0]
            place += pelvis * (1, 0, 1) - place[:, 1].min() * np.array([0, 1, 0])
        return [
            Reach(ours, key.frame / fps, tuple((place[joint] / stage.scale).tolist()))
            for ours, joint in stage.body.joints.items()
            if determined[joint] and ours in HUMANML3D.names
        ]


# Prompt of a request or a segment that has none.
_ANYTHING = "a person walks"

# Options of a request without any.
_OPTIONS = schemas.Options.model_validate({})

# The number of takes, which MMCP has no word for.
_TAKES = schemas.ModelOption.model_validate(
    {
        "name": "takes",
        "type": "integer",
        "title": "Takes",
        "description": "Motions of which the best is returned; 1 is the fastest.",
        "default": 4,
        "minimum": 1,
        "maximum": 16,
    }
)

# Seconds of a motion whose frame is a pose.
_POSE = (1.0, 1.05)


def application(pipeline: MotionPipeline) -> FastAPI:
    """Returns the server of a model: `GET /capabilities` and `POST /generate`."""
    app = motionmcp.build_app(LatentMotionBackbone(pipeline), title="Latent Motion")
    # No web page reaches it by another name that leads to this machine.
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=["localhost", "127.0.0.1"])
    return app
