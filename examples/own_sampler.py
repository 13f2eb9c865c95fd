"""A sampler of your own: Adams-Bashforth of order two, which reuses the estimate before.

python examples/own_sampler.py "a person jumps" jump.bvh
"""

import sys
from dataclasses import dataclass
from itertools import pairwise

from latentmotion import MotionPipeline
from latentmotion.diffusion.schedule import Schedule


@dataclass(frozen=True)
class AdamsBashforth:
    """Steps of DDIM along an estimate that is extrapolated to the middle of the step."""

    schedule: Schedule

    def steps(self, estimate, z, times, noise):
        before = None
        for t, s in pairwise(times):
            now = estimate(z, t)
            z0, epsilon = (1.5 * a - 0.5 * b for a, b in zip(now, before or now, strict=True))
            z, before = self.schedule.alpha(s) * z0 + self.schedule.sigma(s) * epsilon, now
            yield z


class Pipeline(MotionPipeline):
    def sampler(self, sampling):
        return AdamsBashforth(self.card.schedule)


if __name__ == "__main__":
    Pipeline.from_pretrained("starter")(sys.argv[1], seconds=4, steps=20).save(sys.argv[2])
