"""Objects that a motion's files and pages show, from its joints and what its caption tells."""

from __future__ import annotations

from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.language.reading import claims_of, request_of
from latentmotion.measure.objects import ImpliedObject, implied_objects
from latentmotion.motion import Motion


def objects_of(motion: Motion) -> tuple[ImpliedObject, ...]:
    """Returns the objects that carry the body; none for joints other than HumanML3D's."""
    if motion.skeleton.names != HUMANML3D.names:
        return ()
    caption = motion.caption  # a request implies more than captions claim, such as climbing
    kinds = {claim.kind for claim in (*claims_of(caption), *request_of(caption).claims)}
    return implied_objects(motion.joints, motion.fps, kinds)
