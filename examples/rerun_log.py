"""Logs a motion for Rerun: bones, joints and heights over time (pip install rerun-sdk).

python examples/rerun_log.py "a person walks and waves" walk.rrd

Open the file with: rerun walk.rrd
"""

import sys

import rerun

from latentmotion import MotionPipeline


def main(sentence: str, output: str) -> None:
    """Generates and writes a recording."""
    motion = MotionPipeline.from_pretrained()(sentence)
    names, parents = motion.skeleton.names, motion.skeleton.parents
    rerun.init("latentmotion")
    rerun.save(output)
    rerun.log("person", rerun.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    for frame, joints in enumerate(motion.joints):
        rerun.set_time("motion", duration=frame / motion.fps)
        bones = [joints[[parent, joint]] for joint, parent in enumerate(parents) if parent >= 0]
        rerun.log("person/bones", rerun.LineStrips3D(bones, radii=0.02))
        rerun.log("person/joints", rerun.Points3D(joints, radii=0.03))
        for name in ("pelvis", "right_wrist"):
            rerun.log(f"height/{name}", rerun.Scalars(float(joints[names.index(name), 1])))
    rerun.disconnect()


if __name__ == "__main__":
    main(*sys.argv[1:])
