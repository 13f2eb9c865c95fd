"""Plays a motion on a page of viser (pip install viser).

python examples/viser_view.py "a person walks and waves"
"""

import sys
import time

import numpy as np
import viser

from latentmotion import MotionPipeline


def main(sentence: str, port: str = "8080", turns: str = "1000000") -> None:
    """Generates and plays, over and over."""
    motion = MotionPipeline.from_pretrained()(sentence)
    server = viser.ViserServer(host="127.0.0.1", port=int(port))
    server.scene.set_up_direction("+y")
    server.scene.add_grid("/floor", plane="xz")
    pairs = [pair for pair in zip(motion.skeleton.parents, range(22), strict=True) if pair[0] >= 0]
    bones = motion.joints[:, np.array(pairs)]
    red = np.full((*bones.shape[1:3], 3), (220, 60, 40), np.uint8)
    figure = server.scene.add_line_segments("/person", bones[0], colors=red)
    for _ in range(int(turns)):
        for frame in bones:
            figure.points = frame
            time.sleep(1 / motion.fps)
    server.stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
