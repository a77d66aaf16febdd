"""pacnet for LeRobot: importing this registers the policy `pacnet` and the environments `pacnet`.

LeRobot's commands import it themselves if it is installed.
"""

from lerobot_policy_pacnet.configuration_pacnet import PACNetConfig
from lerobot_policy_pacnet.environments import PACNetEnv
from lerobot_policy_pacnet.modeling_pacnet import PACNetPolicy
from lerobot_policy_pacnet.processor_pacnet import make_pacnet_pre_post_processors

__all__ = ["PACNetConfig", "PACNetEnv", "PACNetPolicy", "make_pacnet_pre_post_processors"]
