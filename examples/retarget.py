"""Puts a generated motion on a character: Mixamo, Unreal, VRM, Rigify and others are known.

python examples/retarget.py character.glb "a person waves" waving.glb

The output is the character with the animation added; for a .bvh character it is a .bvh file.
"""

from __future__ import annotations

import sys

from latentmotion import MotionPipeline
from latentmotion.retarget import read_rig
from latentmotion.retarget.transfer import write


def main(character: str, sentence: str, output: str, seconds: str = "4") -> None:
    """Generates, cleans up and carries the motion to the character's skeleton."""
    rig = read_rig(character)
    motion = MotionPipeline.from_pretrained()(sentence, float(seconds))
    for path in write(output, rig, [motion], names=[sentence]):
        print(f"wrote {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
