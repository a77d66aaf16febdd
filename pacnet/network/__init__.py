"""The whole of the paper: `PACNet`, and its earlier system, `SchemaNetwork`."""

from pacnet.network.config import PACNetConfig
from pacnet.network.network import Action, Decision, PACNet, Recall
from pacnet.network.schema_network import SchemaNetwork
from pacnet.network.schema_network_config import SchemaNetworkConfig

__all__ = [
    "Action",
    "Decision",
    "PACNet",
    "PACNetConfig",
    "Recall",
    "SchemaNetwork",
    "SchemaNetworkConfig",
]
