"""The policy's settings, which LeRobot's commands take as `--policy.NAME=VALUE`."""

import json
from dataclasses import dataclass, field
from typing import Any

from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
from lerobot.optim.optimizers import OptimizerConfig, SGDConfig
from lerobot.utils.constants import ACTION, OBS_STATE

TARGETS = ("action", "state")


@PreTrainedConfig.register_subclass("pacnet")
@dataclass
class PACNetConfig(PreTrainedConfig):
    """Settings of a `PACNetPolicy`; what the network needs besides is chosen from the data.

    Attributes:
        targets: what is kept of the demonstrations: the "action", or the "state" that followed
            `lead` frames later, to which a forward model fitted to the same data finds the way.
        lead: frames that such a state lies ahead, ≥ 1.
        normalization_mapping: identity: the normaliser is in the policy, and no other dataset
            changes it.
        push_to_hub: whether LeRobot uploads the policy after training.
        pretrained_revision: of a policy on the Hub; declared here for LeRobot 0.4.4, which would
            refuse the checkpoints of 0.6 without it.

    Raises:
        ValueError: a setting is out of range.
    """

    targets: str = "action"
    lead: int = 1
    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: dict.fromkeys(
            ("STATE", "ENV", "ACTION"), NormalizationMode.IDENTITY
        )
    )
    push_to_hub: bool = False  # type: ignore[assignment]  # as in the base class
    pretrained_revision: str | None = None

    def __post_init__(self) -> None:
        """Refuses settings that are out of range."""
        super().__post_init__()
        if self.targets not in TARGETS:
            raise ValueError(f"expected policy.targets to be one of {TARGETS}, got {self.targets}")
        if self.lead < 1:
            raise ValueError(f"expected policy.lead ≥ 1, got {self.lead}")

    @property
    def percept_features(self) -> dict[str, PolicyFeature]:
        """The features that percepts are made of, in their order: the robot's state comes first."""
        inputs = self.input_features or {}
        return dict(sorted(inputs.items(), key=lambda item: item[0] != OBS_STATE))

    def _vectors(self) -> dict[str, dict[str, Any]]:
        """The features that are no images, as the command line takes them."""
        return {
            name: {"type": feature.type.value, "shape": list(feature.shape)}
            for name, feature in self.percept_features.items()
            if feature.type is not FeatureType.VISUAL
        }

    @property
    def observation_delta_indices(self) -> None:
        """None: frames come one by one, and the policy puts them in order."""
        return

    @property
    def action_delta_indices(self) -> None:
        """None, likewise."""
        return

    @property
    def reward_delta_indices(self) -> None:
        """None: there are no rewards."""
        return

    def get_optimizer_preset(self) -> OptimizerConfig:
        """An optimizer that does nothing: the policy does not learn by gradient."""
        return SGDConfig(lr=0.0)

    def get_scheduler_preset(self) -> None:
        """None: there is nothing to schedule."""
        return

    def validate_features(self) -> None:
        """Refuses features that percepts and actions cannot be made of.

        Raises:
            ValueError: images, a feature that is no vector, no observation at all, or no action.
        """
        for name, feature in self.percept_features.items():
            if feature.type is FeatureType.VISUAL:
                raise ValueError(
                    f"expected vectors to perceive, got the images {name!r}: leave them out with "
                    f"--policy.input_features='{json.dumps(self._vectors())}', or add to the "
                    "dataset what an encoder makes of them as a feature observation.NAME"
                )
            if len(feature.shape) != 1:
                raise ValueError(
                    f"expected {name!r} to be a vector of numbers, got shape {feature.shape}"
                )
        if not self.percept_features:
            raise ValueError("expected a feature observation.NAME to perceive, got none")
        if self.action_feature is None or len(self.action_feature.shape) != 1:
            raise ValueError(
                f"expected the feature {ACTION!r}, a vector, got {self.action_feature}"
            )
