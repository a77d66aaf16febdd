"""The paper's two systems: `PACNet`, and the earlier `SchemaNetwork`."""

from pacnet.network.config import PACNetConfig, SchemaNetworkConfig
from pacnet.network.network import PACNet
from pacnet.network.records import Decision
from pacnet.network.schema_network import SchemaNetwork

__all__ = ["Decision", "PACNet", "PACNetConfig", "SchemaNetwork", "SchemaNetworkConfig"]
