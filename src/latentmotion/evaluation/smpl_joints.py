"""SMPL's joints in place of the free skeleton's, for features that are SMPL's poses.

HumanAct12's classifier sees joints, as metrics of positions do; UESTC's sees rotations alone.
Published figures are those of SMPL's neutral body, whose file only its registered users have.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeGuard

from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.action import Recognizer
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.kinematics.smpl import SmplModel
from latentmotion.representation.smpl import SmplRepresentation, representation_of


def with_smpl_joints(
    body: SmplModel, dataset: Dataset, evaluator: Evaluator | None
) -> tuple[Dataset, Evaluator | None]:
    """Returns data set and evaluator with the joints of a SMPL model.

    Raises:
        InputError: The features are not SMPL's poses.
    """
    representation, features = representation_of(body), dataset.representation.name
    if features != representation.name:
        raise InputError(
            f"{dataset.folder} has features {features!r}, which are no poses of a SMPL body; "
            "leave --body out"
        )
    if _sees_joints(evaluator):
        evaluator = replace(evaluator, prepare=representation.camera_joints)
    return replace(dataset, representation=representation), evaluator


def body_of(dataset: Dataset) -> str:
    """Returns the hash of the SMPL model whose joints the data has; empty without one."""
    representation = dataset.representation
    return representation.body if isinstance(representation, SmplRepresentation) else ""


def lacks_smpl_joints(dataset: Dataset, evaluator: Evaluator | None) -> bool:
    """Returns whether an evaluator made for SMPL's joints sees the free skeleton's."""
    return _on_free_skeleton(dataset) and _sees_joints(evaluator)


def notes_on_joints(dataset: Dataset, evaluator: Evaluator | None) -> list[str]:
    """Returns a note if joints are not those of published figures."""
    if not _on_free_skeleton(dataset):
        return []
    lacking = lacks_smpl_joints(dataset, evaluator)
    which = "this evaluator's metrics and those" if lacking else "metrics"
    return [
        f"joints are those of the free skeleton: {which} of positions do not compare "
        "with published ones, which are of SMPL's body; give its file by --body"
    ]


def _on_free_skeleton(dataset: Dataset) -> bool:
    return isinstance(dataset.representation, SmplRepresentation) and not body_of(dataset)


def _sees_joints(evaluator: Evaluator | None) -> TypeGuard[Recognizer]:
    return isinstance(evaluator, Recognizer) and evaluator.network.sees_joints
