"""The whole of the paper: `PACNet`, and its earlier system, `SchemaNetwork`."""

from pacnet.network.config import PACNetConfig, SchemaNetworkConfig
from pacnet.network.network import PACNet
from pacnet.network.records import Decision
from pacnet.network.schema_network import SchemaNetwork

__all__ = ["Decision", "PACNet", "PACNetConfig", "SchemaNetwork", "SchemaNetworkConfig"]
