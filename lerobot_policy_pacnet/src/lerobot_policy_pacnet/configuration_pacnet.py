"""The policy's settings, which LeRobot's commands take as `--policy.NAME=VALUE`."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
from lerobot.optim.optimizers import OptimizerConfig, SGDConfig
from lerobot.utils.constants import ACTION, OBS_STATE

from pacnet.vision.config import KINDS_TEXT, is_kind
from pacnet.vision.fitting import AUTO

TARGETS = ("action", "state")


@PreTrainedConfig.register_subclass("pacnet")
@dataclass
class PACNetConfig(PreTrainedConfig):
    """Settings of a `PACNetPolicy`; those of the network are chosen from the data.

    Attributes:
        targets: what is stored for each frame: its "action", or the "state" `lead` frames later, to
            which a forward model, fitted to the same data, finds the action.
        lead: frames that such a state lies ahead, ≥ 1.
        points: which dimensions of a percept are points, the one that the robot's actions move
            first, such as `["hand=observation.state[0:3]", "goal=observation.goal"]`. None for
            those that are found by their names, [] for none; see `pacnet.imitator.points`. With a
            body they are the landmarks alone.
        body: folder of a `KinematicModel`, which tells where the hand is from the joint angles
            among the percepts; see `Imitator.from_demonstrations`. None for none, and for that of
            the policy once it has learned: its imitator keeps it.
        cameras: the images among the features that are looked at; None for all, [] for none. Those
            that do not help are not used; see `pacnet.vision`.
        encoder: what looks at them; "auto" for the built-in kind that tells most.
        task: what to do, in the words of the demonstrations, whatever task comes with an
            observation; None for that task, and "" for whatever fits.
        normalization_mapping: identity; the imitator scales percepts itself.
        push_to_hub: whether LeRobot uploads the policy after training.
        pretrained_revision: of a policy on the Hub; declared for LeRobot 0.4.4, which refuses the
            checkpoints of 0.6 without it.

    Raises:
        ValueError: a setting is out of range.
    """

    targets: str = "action"
    lead: int = 1
    points: list[str] | None = None
    body: str | None = None
    cameras: list[str] | None = None
    encoder: str = "auto"
    task: str | None = None
    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: dict.fromkeys(
            ("STATE", "ENV", "VISUAL", "ACTION"), NormalizationMode.IDENTITY
        )
    )
    push_to_hub: bool = False  # type: ignore[assignment]  # as in the base class
    pretrained_revision: str | None = None

    def __post_init__(self) -> None:
        """Check the settings."""
        super().__post_init__()
        if self.targets not in TARGETS:
            raise ValueError(f"expected policy.targets to be one of {TARGETS}, got {self.targets}")
        if self.lead < 1:
            raise ValueError(f"expected policy.lead ≥ 1, got {self.lead}")
        points = [] if self.points is None else self.points
        if not (isinstance(points, list) and all(isinstance(point, str) for point in points)):
            raise ValueError(f"expected policy.points as a list of texts, got {self.points!r}")
        cameras = [] if self.cameras is None else self.cameras
        if not (isinstance(cameras, list) and all(isinstance(name, str) for name in cameras)):
            raise ValueError(f"expected policy.cameras as a list of texts, got {self.cameras!r}")
        if self.encoder != AUTO and not is_kind(self.encoder):
            raise ValueError(f"expected policy.encoder as auto, {KINDS_TEXT}, got {self.encoder!r}")
        if self.body is not None and (self.targets != "action" or self.points == []):
            got = "no points" if self.points == [] else f"policy.targets={self.targets}"
            raise ValueError(
                f"expected policy.body with landmarks and policy.targets=action, got {got}"
            )

    @property
    def percept_features(self) -> dict[str, PolicyFeature]:
        """The features of a percept that are no images, in order, the robot's state first."""
        vectors = {
            name: feature
            for name, feature in (self.input_features or {}).items()
            if feature.type is not FeatureType.VISUAL
        }
        return dict(sorted(vectors.items(), key=lambda item: item[0] != OBS_STATE))

    @property
    def camera_features(self) -> tuple[str, ...]:
        """The images that are looked at."""
        images = self.image_features
        return tuple(images) if self.cameras is None else tuple(self.cameras)

    @property
    def observation_delta_indices(self) -> None:
        """None: each frame is loaded by itself, and the policy restores their order."""
        return

    @property
    def action_delta_indices(self) -> None:
        """None, as above."""
        return

    @property
    def reward_delta_indices(self) -> None:
        """None: there are no rewards."""
        return

    def get_optimizer_preset(self) -> OptimizerConfig:
        """Return an optimizer without effect: the policy does not learn by gradient."""
        return SGDConfig(lr=0.0)

    def get_scheduler_preset(self) -> None:
        """Return None: there is nothing to schedule."""
        return

    def validate_features(self) -> None:
        """Check that percepts and actions are vectors, beside images.

        Raises:
            ValueError: a feature that is neither vector nor image, no vector that is observed, no
                action, or a camera that is not among the features.
        """
        for name, feature in self.percept_features.items():
            if len(feature.shape) != 1:
                raise ValueError(
                    f"expected {name!r} to be a vector of numbers, got shape {feature.shape}"
                )
        if not self.percept_features:
            raise ValueError("expected a vector observation.NAME, got none")
        for name in self.camera_features:
            if name not in self.image_features:
                images = ", ".join(self.image_features) or "none"
                raise ValueError(f"expected policy.cameras out of {images}, got {name!r}")
        if self.action_feature is None or len(self.action_feature.shape) != 1:
            raise ValueError(
                f"expected the feature {ACTION!r}, a vector, got {self.action_feature}"
            )
