"""Train LeRobot's ACT on recorded arrays, then answer states and pictures with actions.

`act` starts it with the path of the arrays. It imports LeRobot and no Metaworld.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

SECONDS = 150.0  # of training
CHUNK, SENT = 40, 10  # actions that are foretold, and of which so many are sent, at 80 Hz
BATCH, RATE, SEED = 8, 1e-4, 0
SHRINK = 2  # sides of pictures; the whole ones would leave time for a few steps of training only
RESET, FRAME = b"r", b"f"
STATE, IMAGE, ACTION = "observation.state", "observation.image", "action"

Arrays = Mapping[str, NDArray[np.generic]]


class Samples:
    """Frames with the actions that follow, in units of their standard deviation."""

    def __init__(self, arrays: Arrays) -> None:
        self.states, self.state_scale = _scaled(arrays["states"])
        self.actions, self.action_scale = _scaled(arrays["actions"])
        self.pictures = torch.from_numpy(arrays["pictures"])
        lengths = torch.from_numpy(arrays["lengths"])
        self._ends = lengths.cumsum(0).repeat_interleave(lengths)  # [N], of a frame's episode

    def batch(self, rows: Tensor) -> dict[str, Tensor]:
        """Return a batch of frames `[B]` as ACT wants it."""
        ahead, ends = rows[:, None] + torch.arange(CHUNK), self._ends[rows, None]
        return {
            STATE: self.states[rows],
            IMAGE: as_input(self.pictures[rows]),
            ACTION: self.actions[torch.minimum(ahead, ends - 1)],
            "action_is_pad": ahead >= ends,
        }


def as_input(pictures: Tensor) -> Tensor:
    """Return pictures `[B, H, W, 3]` as the network sees them, `[B, 3, H / 2, W / 2]`, in ±1."""
    return nn.functional.avg_pool2d(pictures.permute(0, 3, 1, 2).float(), SHRINK) / 127.5 - 1


def small_policy(side: int) -> nn.Module:
    """Return an untrained ACT that a CPU can train; its backbone is not pretrained either."""
    from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy

    config = ACTConfig(
        input_features={
            STATE: PolicyFeature(FeatureType.STATE, (4,)),
            IMAGE: PolicyFeature(FeatureType.VISUAL, (3, side // SHRINK, side // SHRINK)),
        },
        output_features={ACTION: PolicyFeature(FeatureType.ACTION, (4,))},
        normalization_mapping={kind.name: NormalizationMode.IDENTITY for kind in FeatureType},
        device="cpu", chunk_size=CHUNK, n_action_steps=SENT, pretrained_backbone_weights=None,
        dim_model=128, n_heads=4, dim_feedforward=512, n_encoder_layers=2, latent_dim=16,
        n_vae_encoder_layers=2,
    )  # fmt: skip
    return ACTPolicy(config)


def train(policy: nn.Module, samples: Samples) -> int:
    """Train a policy for `SECONDS`; return the number of steps."""
    random, began, steps = torch.Generator().manual_seed(SEED), time.monotonic(), 0
    optimizer = torch.optim.AdamW(policy.parameters(), RATE, weight_decay=1e-4)
    policy.train()
    while time.monotonic() - began < SECONDS:
        rows = torch.randint(len(samples.states), (BATCH,), generator=random)
        loss = policy(samples.batch(rows))[0]
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(policy.parameters(), 10.0)
        optimizer.step()
        steps += 1
    return steps


def answer(policy: nn.Module, samples: Samples, side: int, asked: BinaryIO) -> None:
    """Answer each frame with an action until nobody asks any more."""
    policy.eval()
    while kind := asked.read(1):
        if kind == RESET:
            policy.reset()
            continue
        state = torch.frombuffer(bytearray(asked.read(16)), dtype=torch.float32)
        seen = bytearray(asked.read(3 * side * side))
        picture = torch.frombuffer(seen, dtype=torch.uint8).view(1, side, side, 3)
        mean, deviation = samples.state_scale
        batch = {STATE: ((state - mean) / deviation)[None], IMAGE: as_input(picture)}
        with torch.inference_mode():
            action = policy.select_action(batch)[0]
        mean, deviation = samples.action_scale
        sys.stdout.buffer.write((action * deviation + mean).numpy().tobytes())
        sys.stdout.buffer.flush()


def _scaled(rows: NDArray[np.generic]) -> tuple[Tensor, tuple[Tensor, Tensor]]:
    """Return rows `[N, D]`, centred and scaled, with their mean and standard deviation `[D]`."""
    values = torch.from_numpy(rows).float()
    mean, deviation = values.mean(dim=0), values.std(dim=0).clamp(min=1e-3)
    return (values - mean) / deviation, (mean, deviation)


def main() -> None:
    """Train, say so, and answer."""
    torch.manual_seed(SEED)
    arrays = dict(np.load(sys.argv[1]))
    samples, side = Samples(arrays), arrays["pictures"].shape[1]
    policy = small_policy(side)
    print(f"{train(policy, samples)} steps of training", flush=True)
    answer(policy, samples, side, sys.stdin.buffer)


if __name__ == "__main__":
    main()
