"""`print(module)` tells how much a module has learned and what it takes."""

import numpy as np
import torch

from pacnet import (
    CompetingSchemasConfig,
    Imitator,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    SchemaNetwork,
    SchemaNetworkConfig,
    SOFMConfig,
)
from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.datasets import Demonstration, Demonstrations


def circle() -> tuple[torch.Tensor, torch.Tensor]:
    angle = torch.linspace(0, 6.28, 200)
    return torch.stack([angle.cos(), angle.sin()], dim=1), angle.sin()[:, None]


def test_rows_tell_their_number_and_their_columns():
    rows = GrowableRows({"place": Column((2,), torch.float32), "age": Column((), torch.int64)})
    assert repr(rows) == "GrowableRows(rows=0, columns=(place[2], age))"
    rows.extend(3)
    assert repr(rows) == "GrowableRows(rows=3, columns=(place[2], age))"


def test_a_network_tells_nodes_edges_dimensions_and_targets():
    attention = SOFMConfig.paper(dimensions=2, novelty_threshold=0.7)
    net = PACNet(PACNetConfig(attention, MotorSchemasConfig(1, percept_dimensions=2)))
    assert "(sofm): HabituatingSOFM(\n    nodes=0, edges=0, dimensions=2\n" in repr(net)
    for episode in range(3):
        net.observe(*circle(), episode)
    shown = repr(net)
    assert "PACNet(\n  percept_dimensions=2, target_dimensions=1\n" in shown
    assert f"nodes={len(net.sofm)}, edges={len(net.sofm.edges)}, dimensions=2\n" in shown
    stored = sum(len(net.schemas.targets(node)) for node in range(len(net.sofm)))
    assert stored > 0
    assert f"nodes={len(net.sofm)}, targets={stored}, target_dimensions=1\n" in shown


def test_competing_schemas_tell_their_episodes_and_behaviours():
    attention = SOFMConfig.paper(dimensions=2, novelty_threshold=0.7)
    net = PACNet(PACNetConfig(attention, CompetingSchemasConfig(1, percept_dimensions=2)))
    for episode in range(2):
        net.observe(*circle(), episode, "turn")
    schemas = f"schemas={len(net.schemas.blocks)}, episodes=2, behaviours=['turn']\n"
    assert schemas in repr(net.schemas)


def test_an_imitator_tells_demonstrations_dimensions_and_rate():
    percepts, actions = circle()
    shown = Demonstration(0, "turn", percepts, torch.empty(200, 0), actions)
    names = {"observation.state": ("x", "y"), "action": ("motor",)}
    demonstrations = Demonstrations(50, names, (shown,), "turning")
    imitator = Imitator.from_demonstrations(demonstrations)
    settings = "percept_dimensions=2, action_dimensions=1, fps=50"
    assert repr(imitator).startswith(f"Imitator(\n  demonstrations=0, {settings}\n")
    imitator.learn(demonstrations)
    imitator.step(np.float32([1, 0]))
    assert repr(imitator).startswith(f"Imitator(\n  demonstrations=1, {settings}\n")


def test_a_schema_network_tells_its_schemas():
    network = SchemaNetwork(SchemaNetworkConfig(2, 1))
    network.add_schema(*circle())
    assert "schemas=1, targets=200, percept_dimensions=2, target_dimensions=1\n" in repr(network)
