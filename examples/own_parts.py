"""Parts of your own: a text encoder, a noise schedule, a sampler and a metric.

python examples/own_parts.py prints the settings for --data DATA --vae VAE -o RUN

Their package has these entry points; the command that trains with them is printed:
"latentmotion.text_encoders" = { letters = "own_parts:Letters" }
"latentmotion.schedules" = { circle = "own_parts:Circle" }
"latentmotion.samplers" = { adams = "own_sampler:AdamsBashforth" }
"latentmotion.metrics" = { reach = "own_parts:reach" }
"""

import math

import numpy as np

from latentmotion.arrays import array_namespace
from latentmotion.diffusion.condition import TextEmbedding


class Letters:
    """Counts letters; what follows the colon in `--text-encoder letters:abc` are those."""

    def __init__(self, letters):
        self.letters, self.name, self.width = letters, f"letters:{letters}", len(letters)

    def __call__(self, sentences):
        pooled = np.array([[s.count(c) for c in self.letters] for s in sentences], np.float32)
        return TextEmbedding(pooled, pooled[:, None], np.ones((len(pooled), 1), bool))


class Circle:
    """alpha = cos, sigma = sin: variance preserving, with times from 0 to 1."""

    def alpha(self, t):
        return self.sigma(1 - t)

    def sigma(self, t):
        where = math if isinstance(t, (int, float)) else array_namespace(t)
        return where.sin(t * (math.pi / 2))

    def velocity_coefficients(self, t):
        return -self.sigma(t), self.alpha(t)

    def time_at(self, u):
        return u

    def timesteps(self, steps):
        return np.linspace(1, 0, steps + 1, dtype=np.float32)


def reach(motions, real, representation):
    """Mean distance of the wrists, meters."""
    joints = [representation.decode(motion) for motion in motions]
    return {"Reach": np.mean([np.linalg.norm(j[:, 20] - j[:, 21], axis=-1).mean() for j in joints])}


CIRCLE = 'denoiser_objective.schedule={"kind": "PluginSchedule", "plugin": "circle"}'

if __name__ == "__main__":
    print(f"--text-encoder letters:abc --set sampling.sampler=adams --set '{CIRCLE}'")
