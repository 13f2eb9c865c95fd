"""Whose joints an evaluation sees where features are SMPL's poses: the same turns, other bones.

HumanAct12's classifier looks at joints, as metrics of positions do; UESTC's looks at turns alone.
Published figures are those of SMPL's neutral body, which only its users may have.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeGuard

from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.evaluation.extractors.action_network import Recognizer
from latentmotion.evaluation.observation import Extractor
from latentmotion.kinematics.smpl import SmplModel
from latentmotion.representation.smpl import SmplRepresentation, representation_of


def seen_on(
    body: SmplModel, dataset: Dataset, extractor: Extractor | None
) -> tuple[Dataset, Extractor | None]:
    """Returns data and evaluator with the joints of a SMPL model.

    Raises:
        InputError: The features are not SMPL's poses.
    """
    representation, found = representation_of(body), dataset.representation.name
    if found != representation.name:
        raise InputError(
            f"{dataset.folder} has features {found!r}, which are no poses of a SMPL body; "
            "leave --body out"
        )
    if _looks_at_joints(extractor):
        extractor = replace(extractor, prepare=representation.camera_joints)
    return replace(dataset, representation=representation), extractor


def body_of(dataset: Dataset) -> str:
    """Returns the hash of the body that the data's joints are of; empty without one."""
    part = dataset.representation
    return part.body if isinstance(part, SmplRepresentation) else ""


def on_stand_in(dataset: Dataset, extractor: Extractor | None) -> bool:
    """Returns whether an evaluator made for SMPL's joints sees the skeleton that ships."""
    return _lacks_body(dataset) and _looks_at_joints(extractor)


def remarks_on_body(dataset: Dataset, extractor: Extractor | None) -> list[str]:
    """Says where joints are not those of published figures."""
    if not _lacks_body(dataset):
        return []
    which = "this evaluator's metrics and those" if on_stand_in(dataset, extractor) else "metrics"
    return [
        f"joints are those of the free skeleton: {which} of positions do not compare "
        "with published ones, which are of SMPL's body; give its file by --body"
    ]


def _lacks_body(dataset: Dataset) -> bool:
    return isinstance(dataset.representation, SmplRepresentation) and not body_of(dataset)


def _looks_at_joints(extractor: Extractor | None) -> TypeGuard[Recognizer]:
    return isinstance(extractor, Recognizer) and extractor.network.sees_joints
