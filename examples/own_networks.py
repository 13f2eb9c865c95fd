"""Networks of your own: a VAE of one linear layer, and a denoiser with a GRU for its transformer.

python examples/own_networks.py --data DATA -o my_runs

Their package names them by entry points; here the command that trains them is printed:
"latentmotion.vaes" = { linear = "own_networks:LinearVAE" }
"latentmotion.denoisers" = { recurrent = "own_networks:recurrent" }
"""

import sys

import torch
from torch import nn

from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.vae.interface import MotionVAE, Posterior


class LinearVAE(MotionVAE):
    def __init__(self, features, width):
        super().__init__()
        self.latent_width = width
        self.encoder, self.decoder = nn.Linear(features, 2 * width), nn.Linear(width, features)

    def encode(self, features, mask):
        return Posterior(*self.encoder(features * mask[..., None]).chunk(2, dim=-1))

    def decode(self, latents, mask):
        return self.decoder(latents) * mask[..., None]

    def latent_mask(self, mask):
        return mask  # a token per frame


class Recurrent(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.network = nn.GRU(width, width, batch_first=True)

    def forward(self, latents, mask, context, context_mask):
        both = torch.cat([context * context_mask[..., None], latents * mask[..., None]], dim=1)
        return self.network(both)[0][:, context.shape[1] :]


def recurrent(config):
    """Returns the denoiser of a configuration."""
    network = DenoiserNetwork(config)
    network.body = Recurrent(config.transformer.width)
    return network


VAE = '{"kind": "PluginVAEConfig", "plugin": "linear", "settings": {"width": 8}, "space": {"width": 8, "frames_per_token": 1}}'  # noqa: E501

if __name__ == "__main__":
    print("latentmotion train vae --set", f"'vae={VAE}'", *sys.argv[1:])
    print("latentmotion train denoiser --set denoiser.plugin=recurrent", *sys.argv[1:])
