"""Objects that a motion's files and pages show, from its joints and what its caption tells."""

from __future__ import annotations

from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.language.reading import claims_of
from latentmotion.measure.objects import ImpliedObject, implied_objects
from latentmotion.motion import Motion


def objects_of(motion: Motion) -> tuple[ImpliedObject, ...]:
    """Returns the objects that carry the body; none for joints other than HumanML3D's."""
    if motion.skeleton.names != HUMANML3D.names:
        return ()
    told = {claim.kind for claim in claims_of(motion.caption)}
    return implied_objects(motion.joints, motion.fps, told)
