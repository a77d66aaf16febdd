"""Checkpoints: which ones are refused, and that writing them is atomic."""

import json
import math
import os
import random
import signal
import time
from collections.abc import Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import pytest
import torch

from pacnet import CompetingSchemasConfig, MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.core import checkpoint as module
from pacnet.core.checkpoint import (
    load_checkpoint,
    read_checkpoint,
    save_checkpoint,
    write_checkpoint,
)
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.imitator.imitator import Imitator
from pacnet.network.schema_network import SchemaNetwork


def make_network(value: float, recall_by: str = "cue") -> PACNet:
    config = PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, 2, recall_by=recall_by))
    network = PACNet(config)
    network.observe(torch.full((30, 2), value), torch.full((30, 1), value), episode=0)
    return network


@pytest.fixture
def checkpoint(tmp_path):
    make_network(1.0).save_pretrained(tmp_path / "net")
    return tmp_path / "net"


def rewrite_tensors(folder, change) -> None:
    fields, tensors = read_checkpoint(folder)
    change(tensors)
    write_checkpoint(folder, fields, tensors)


def rewrite_config(folder, **fields) -> None:
    document = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**document, **fields}))


def test_a_checkpoint_is_two_files_and_leaves_others_alone(checkpoint):
    (checkpoint / "metrics.json").write_text("{}")
    make_network(2.0).save_pretrained(checkpoint)
    names = sorted(path.name for path in checkpoint.iterdir())
    assert names == ["config.json", "metrics.json", "model.safetensors"]


def test_the_same_network_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        make_network(1.0).save_pretrained(tmp_path / name)
    for file in ("config.json", "model.safetensors"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("schemas.pool.target", r"schemas\.pool\.target of shape \[rows, 1\], got none"),
        ("schemas.blocks.length", r"MotorSchemas, got \['blocks\.length'\] missing, none extra"),
        ("episode", r"\['episode'\] missing, none extra"),
    ],
)
def test_a_missing_tensor_is_named(checkpoint, name, message):
    rewrite_tensors(checkpoint, lambda tensors: tensors.pop(name))
    with pytest.raises(ValueError, match=message):
        PACNet.from_pretrained(checkpoint)


def test_an_extra_tensor_is_named(checkpoint):
    rewrite_tensors(checkpoint, lambda tensors: tensors.update(more=torch.zeros(1)))
    with pytest.raises(ValueError, match=r"none missing, \['more'\] extra"):
        PACNet.from_pretrained(checkpoint)


def test_a_misshapen_tensor_is_named(checkpoint):
    def widen(tensors):
        tensors["sofm.nodes.prototype"] = torch.zeros(1, 5)

    rewrite_tensors(checkpoint, widen)
    with pytest.raises(ValueError, match=r"nodes.prototype.*\[1, 5\]"):
        PACNet.from_pretrained(checkpoint)


def test_columns_of_unequal_length_are_named(checkpoint):
    def shorten(tensors):
        tensors["schemas.pool.cue"] = tensors["schemas.pool.cue"][:3].clone()

    rewrite_tensors(checkpoint, shorten)
    with pytest.raises(ValueError, match=r"pool\.cue of MotorSchemas .*\[19, 2\], got .*\[3, 2\]"):
        PACNet.from_pretrained(checkpoint)


def test_fewer_schemas_than_nodes_are_refused(checkpoint):
    def drop(tensors):
        for name in ("start", "length", "capacity", "episode", "habituated_at", "forgotten"):
            tensors[f"schemas.blocks.{name}"] = torch.zeros(0, dtype=torch.int64)
        for name in ("target", "cue"):
            tensors[f"schemas.pool.{name}"] = tensors[f"schemas.pool.{name}"][:0].clone()

    rewrite_tensors(checkpoint, drop)
    with pytest.raises(ValueError, match="got 0 for 1 nodes"):
        PACNet.from_pretrained(checkpoint)


@pytest.mark.parametrize("file", ["config.json", "model.safetensors"])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_truncated_file_is_named(checkpoint, file, share):
    content = (checkpoint / file).read_bytes()
    (checkpoint / file).write_bytes(content[: int(share * len(content))])
    with pytest.raises(ValueError, match=f"expected .*{file}"):
        PACNet.from_pretrained(checkpoint)


def test_a_newer_version_is_refused(checkpoint):
    rewrite_config(checkpoint, version=2)
    with pytest.raises(ValueError, match="version 1, got 2"):
        PACNet.from_pretrained(checkpoint)


def test_another_format_is_refused(checkpoint):
    rewrite_config(checkpoint, format="other")
    with pytest.raises(ValueError, match="format 'pacnet'"):
        PACNet.from_pretrained(checkpoint)


def test_an_unknown_field_is_named(checkpoint):
    config, tensors = read_checkpoint(checkpoint)
    config["attention"]["colour"] = 1
    write_checkpoint(checkpoint, config, tensors)
    with pytest.raises(ValueError, match="colour"):
        PACNet.from_pretrained(checkpoint)


def test_an_edited_config_is_used_with_a_warning(checkpoint):
    config = json.loads((checkpoint / "config.json").read_text())["config"]
    config["attention"]["novelty_threshold"] = 0.25
    rewrite_config(checkpoint, config=config)
    with pytest.warns(UserWarning, match=r"config.json' is not the one that was written"):
        network = PACNet.from_pretrained(checkpoint)
    assert network.config.attention.novelty_threshold == 0.25
    network.save_pretrained(checkpoint)
    PACNet.from_pretrained(checkpoint)  # and warns no more


def test_the_config_names_the_kind_of_model_and_older_ones_of_networks_need_not(checkpoint):
    config, tensors = read_checkpoint(checkpoint)
    assert config.pop("model") == "PACNet"
    for kind in (Imitator, MLPForwardModel, SchemaNetwork):
        with pytest.raises(ValueError, match=f"checkpoint of {kind.__name__} in .*got one of 'PAC"):
            kind.from_pretrained(checkpoint)
    write_checkpoint(checkpoint, config, tensors)
    assert len(PACNet.from_pretrained(checkpoint).sofm) == 1
    write_checkpoint(checkpoint, {"model": "Imitator", **config}, tensors)
    with pytest.raises(ValueError, match=r"of PACNet in .*got one of 'Imitator'"):
        PACNet.from_pretrained(checkpoint)


def test_what_is_not_finite_is_neither_saved_nor_loaded(tmp_path):
    good, bad = {"rows": torch.ones(2)}, {"rows": torch.tensor([1.0, math.nan])}
    save_checkpoint(tmp_path, "Model", {"width": 2}, good)
    with pytest.raises(ValueError, match="expected finite rows, got NaN"):
        save_checkpoint(tmp_path, "Model", {"width": 3}, bad)
    fields, tensors = load_checkpoint(tmp_path, "Model")
    assert fields == {"width": 2}
    assert torch.equal(tensors["rows"], good["rows"])
    write_checkpoint(tmp_path, {"model": "Model"}, bad)
    with pytest.raises(ValueError, match=f"expected finite rows in '{tmp_path}', got NaN"):
        load_checkpoint(tmp_path, "Model")


def test_a_folder_without_a_checkpoint_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"expected a checkpoint folder.*nowhere"):
        PACNet.from_pretrained(tmp_path / "nowhere")


@pytest.mark.parametrize("step", ["config.json.new", "model.safetensors.new", "model", "config"])
def test_stopping_while_writing_leaves_the_old_or_the_new_checkpoint(checkpoint, monkeypatch, step):
    """Stops the writer at every point at which a kill could leave another state on disk."""
    calls = {"config.json.new": 1, "model.safetensors.new": 2}

    class KilledError(Exception):
        pass

    write, replace = module.open_synced, module.Path.replace
    done = []

    @contextmanager
    def counted_write(path):
        with write(path) as file:
            yield file
        done.append(path.name)
        if len(done) == calls.get(step):
            raise KilledError

    def counted_replace(source, target):
        replace(source, target)
        if target.name.startswith(step):
            raise KilledError

    monkeypatch.setattr(module, "open_synced", counted_write)
    monkeypatch.setattr(module.Path, "replace", counted_replace)
    with pytest.raises(KilledError):
        make_network(2.0, recall_by="order").save_pretrained(checkpoint)
    loaded = PACNet.from_pretrained(checkpoint)
    new = loaded.sofm.prototypes[0, 0].item() == 2.0
    assert new == (step in ("model", "config"))
    assert loaded.config.schemas.recall_by == ("order" if new else "cue")


def write_forever(sources: Sequence[Path], folder: Path, ready: Connection) -> None:
    """Write one network over the other, until killed."""
    networks = [PACNet.from_pretrained(source) for source in sources]
    networks[0].save_pretrained(folder)
    ready.send(True)
    while True:
        for network in reversed(networks):
            network.save_pretrained(folder)


def make_large_network(value: float, recall_by: str) -> PACNet:
    """Writing it takes a while."""
    network = make_network(value, recall_by)
    network.schemas.pool.extend(200_000)
    for name in ("target", "cue"):
        network.schemas.pool.live(name)[:] = value
    network.schemas.blocks.live("start")[0] = 0
    for name in ("length", "capacity"):
        network.schemas.blocks.live(name)[0] = len(network.schemas.pool)
    return network


@pytest.mark.slow
def test_sigkill_at_random_instants_leaves_the_old_or_the_new_checkpoint(forks, tmp_path):
    sources = [tmp_path / "old", tmp_path / "new"]
    for value, source, recall_by in zip((1.0, 2.0), sources, ("cue", "order"), strict=True):
        make_large_network(value, recall_by).save_pretrained(source)
    rng = random.Random(0)
    seen = set()
    folder = tmp_path / "net"  # one for all, so that each writer starts on what the last one left
    for _ in range(50):
        pipe, ready = forks.Pipe(duplex=False)
        writer = forks.Process(target=write_forever, args=(sources, folder, ready))
        writer.start()
        ready.close()  # so that a writer that fails is an error here, and not waited for
        assert pipe.recv()
        time.sleep(rng.uniform(0, 0.1))
        writer.kill()
        writer.join()
        assert writer.exitcode == -signal.SIGKILL
        network = PACNet.from_pretrained(folder)
        number = network.sofm.prototypes[0, 0].item()
        assert network.config.schemas.recall_by == {1.0: "cue", 2.0: "order"}[number]
        assert (network.schemas.targets(0) == number).all()
        seen.add(number)
    assert seen == {1.0, 2.0}


def test_files_are_on_the_disk_before_they_are_renamed_and_the_folder_after(tmp_path, monkeypatch):
    done, replace = [], module.Path.replace

    def logged_replace(source, target):
        done.append("rename")
        return replace(source, target)

    monkeypatch.setattr(os, "fsync", lambda _handle: done.append("sync"))
    monkeypatch.setattr(module.Path, "replace", logged_replace)
    make_network(1.0).save_pretrained(tmp_path)
    assert done == ["sync", "sync", "rename", "rename", "sync"]


@pytest.mark.parametrize("version", [0, 2, "1", None])
def test_any_other_version_is_refused(checkpoint, version):
    rewrite_config(checkpoint, version=version)
    with pytest.raises(ValueError, match=f"version 1, got {version!r}"):
        PACNet.from_pretrained(checkpoint)


def test_missing_folders_are_made(tmp_path):
    make_network(1.0).save_pretrained(tmp_path / "one" / "two")
    assert len(PACNet.from_pretrained(tmp_path / "one" / "two").sofm) == 1


def test_tensors_without_a_config_are_refused(checkpoint):
    (checkpoint / "config.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"expected config\.json beside model\.safetensors"):
        PACNet.from_pretrained(checkpoint)


def test_a_config_that_is_no_object_is_refused(checkpoint):
    rewrite_config(checkpoint, config=[1])
    with pytest.raises(ValueError, match="an object under 'config'"):
        PACNet.from_pretrained(checkpoint)


def test_transposed_tensors_come_back_as_they_were(tmp_path):
    matrix = torch.arange(6.0).reshape(2, 3).T
    write_checkpoint(tmp_path, {}, {"matrix": matrix})
    assert torch.equal(read_checkpoint(tmp_path)[1]["matrix"], matrix)


def test_two_stops_in_a_row_do_not_mix_two_checkpoints(checkpoint, monkeypatch):
    class KilledError(Exception):
        pass

    replace, write = Path.replace, module.open_synced

    def stop_after_tensors(source, target):
        replace(source, target)
        raise KilledError

    @contextmanager
    def stop_after_first_write(path):
        with write(path) as file:
            yield file
        raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(module.Path, "replace", stop_after_tensors)
        with pytest.raises(KilledError):
            make_network(2.0, recall_by="order").save_pretrained(checkpoint)
    with monkeypatch.context() as patch:
        patch.setattr(module, "open_synced", stop_after_first_write)
        with pytest.raises(KilledError):
            make_network(3.0).save_pretrained(checkpoint)
    loaded = PACNet.from_pretrained(checkpoint)
    assert loaded.sofm.prototypes[0, 0].item() == 2.0
    assert loaded.config.schemas.recall_by == "order"


CONTRADICTIONS = {
    "sofm.nodes.prototype": (math.nan, r"finite sofm\.nodes\.prototype"),
    "sofm.nodes.habituation": (1.5, "habituation between"),
    "sofm.nodes.habituated_at": (10**6, "habituated_at in the past"),
    "sofm.edges.ends": (99, "nodes that exist"),
    "sofm.edges.age": (-1, "ages of edges"),
    "schemas.pool.target": (1e20, "finite targets, not too large"),
    "schemas.pool.cue": (math.inf, r"finite schemas\.pool\.cue"),
    "schemas.blocks.start": (10**6, "laid end to end"),
    "schemas.blocks.length": (-1, "lengths of sequences"),
    "schemas.blocks.capacity": (0, "blocks as long as their sequences"),
}


def make_two_nodes() -> PACNet:
    network = make_network(1.0)
    network.observe(torch.full((30, 2), 9.0), torch.full((30, 1), 9.0), episode=0)
    return network


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_tensors_that_contradict_one_another_are_refused(tmp_path, name):
    make_two_nodes().save_pretrained(tmp_path)
    value, message = CONTRADICTIONS[name]
    rewrite_tensors(tmp_path, lambda tensors: tensors[name].view(-1).__setitem__(-1, value))
    with pytest.raises(ValueError, match=message):
        PACNet.from_pretrained(tmp_path)


@pytest.mark.parametrize(
    ("ends", "message"), [([[1, 0]], "lower node first"), ([[0, 1], [0, 1]], "one edge between")]
)
def test_edges_that_contradict_one_another_are_refused(tmp_path, ends, message):
    make_two_nodes().save_pretrained(tmp_path)
    edges = {"ends": torch.tensor(ends), "age": torch.zeros(len(ends), dtype=torch.int64)}
    named = {f"sofm.edges.{name}": tensor for name, tensor in edges.items()}
    rewrite_tensors(tmp_path, lambda tensors: tensors.update(named))
    with pytest.raises(ValueError, match=message):
        PACNet.from_pretrained(tmp_path)


def test_a_tensor_of_another_dtype_is_named(checkpoint):
    def loosen(tensors):
        tensors["schemas.blocks.start"] = tensors["schemas.blocks.start"].float() + 0.5

    rewrite_tensors(checkpoint, loosen)
    with pytest.raises(ValueError, match=r"blocks\.start .* as integers .*got torch\.float32"):
        PACNet.from_pretrained(checkpoint)


def test_a_network_in_double_precision_comes_back_as_one(tmp_path):
    make_network(1.0).double().save_pretrained(tmp_path)
    assert PACNet.from_pretrained(tmp_path).sofm.prototypes.dtype == torch.float64


def test_a_contradictory_network_never_replaces_a_good_checkpoint(checkpoint):
    broken = make_network(2.0)
    broken.schemas.add_node()
    with pytest.raises(ValueError, match="got 2 for 1 nodes"):
        broken.save_pretrained(checkpoint)
    assert PACNet.from_pretrained(checkpoint).sofm.prototypes[0, 0].item() == 1.0


# Several schemas per node


def make_competing() -> PACNet:
    """Two nodes; two episodes that pass both, a third in progress: four schemas, six visits."""
    network = PACNet(PACNetConfig(SOFMConfig.paper(2), CompetingSchemasConfig(1, 2)))
    for node in (0.0, 9.0):  # they habituate
        network.observe(torch.full((11, 2), node), torch.zeros(11, 1), episode=0, behaviour="tea")
    for episode, behaviour in ((1, "tea"), (2, "crème"), (3, "tea")):
        for node in (0.0, 9.0):
            percepts = torch.full((4, 2), node)
            network.observe(percepts, percepts[:, :1], episode, behaviour)
    return network


def rewrite_one(folder, name: str, place: int, value: float) -> None:
    rewrite_tensors(folder, lambda tensors: tensors[name].view(-1).__setitem__(place, value))


def test_competing_schemas_come_back_with_the_behaviours_names(tmp_path):
    network = make_competing()
    network.save_pretrained(tmp_path)
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.config == network.config
    assert loaded.behaviours == ("tea", "crème")
    assert len(loaded.schemas) == 2
    assert loaded.schemas.blocks.live("support").tolist() == [2, 2, 0, 0]
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, loaded.state_dict()[name]), name
    percepts = torch.full((5, 2), 9.0)
    for one, other in zip(network.recognise(percepts), loaded.recognise(percepts), strict=True):
        assert torch.equal(one, other)
    for one in (network, loaded):
        one.observe(percepts, percepts[:, :1], episode=4, behaviour="third")
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, loaded.state_dict()[name]), name


def test_competing_schemas_in_double_precision_come_back_as_such(tmp_path):
    make_competing().double().save_pretrained(tmp_path)
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.schemas.pool.live("cue").dtype == torch.float64
    assert loaded.behaviours == ("tea", "crème")


DAMAGES = [
    ("schemas.blocks.node", 0, -1, "schemas of nodes that exist"),
    ("schemas.blocks.node", -1, 2, "schemas of nodes that exist"),
    ("schemas.nodes", 0, 3, "motor schemas for each node, got 3 for 2 nodes"),
    ("schemas.blocks.typical_length", 0, math.nan, r"finite schemas\.blocks\.typical_length"),
    ("schemas.blocks.typical_length", 0, 0, "a typical length > 0 of what has support"),
    ("schemas.blocks.fit", -1, math.inf, r"finite schemas\.blocks\.fit"),
    ("schemas.blocks.continuation", -1, math.nan, r"finite schemas\.blocks\.continuation"),
    ("schemas.blocks.support", 0, 3, "a visit for each support"),
    ("schemas.blocks.support", 0, -1, "support ≥ 0"),
    ("schemas.episodes.last_cue", 0, -1e20, "finite last cues, not too large"),
    ("schemas.episodes.behaviour", 0, -1, "behaviours that have a name"),
    ("schemas.episodes.behaviour", -1, 2, "behaviours that have a name"),
    ("schemas.episodes.number", 0, 1, "ascending numbers of episodes"),
    ("schemas.visits.episode", 0, -1, "visits of episodes that exist"),
    ("schemas.visits.episode", -1, 4, "visits of episodes that exist"),
    ("schemas.visits.schema", 0, -1, "visits of schemas that exist"),
    ("schemas.visits.schema", -1, 4, "visits of schemas that exist"),
    ("schemas.visits.first", 0, -1, "visits within their episodes"),
    ("schemas.visits.first", 0, 4, "visits within their episodes"),
    ("schemas.visits.last", -1, 8, "visits within their episodes"),
    ("schemas.episodes.samples", -1, 7, "visits within their episodes"),
    ("schemas.pool.cue", 0, 1e20, "finite cues, not too large"),
    ("schemas.blocks.shown_in", 0, -1, "sequences of episodes that exist"),
    ("schemas.blocks.shown_in", -1, 4, "sequences of episodes that exist"),
    ("schemas.blocks.shown_in", -1, 0, "a visit in which each sequence was shown"),
    ("schemas.pool.frame", 0, 7, "a visit in which each sequence was shown"),
    ("schemas.pool.frame", 1, -1, "frames of their episodes"),
    ("schemas.pool.frame", 1, 8, "frames of their episodes"),
    ("schemas.episodes.samples", 0, -1, "episodes of so many samples"),
]


@pytest.mark.parametrize(("name", "place", "value", "message"), DAMAGES)
def test_competing_schemas_that_contradict_one_another_are_refused(
    tmp_path, name: str, place: int, value: float, message: str
):
    make_competing().save_pretrained(tmp_path)
    assert len(PACNet.from_pretrained(tmp_path).schemas.visits) == 6
    rewrite_one(tmp_path, name, place, value)
    with pytest.raises(ValueError, match=message):
        PACNet.from_pretrained(tmp_path)


def test_a_schema_without_a_target_is_refused(tmp_path):
    make_competing().save_pretrained(tmp_path)

    def empty(tensors):
        for column in ("length", "capacity"):
            tensors[f"schemas.blocks.{column}"][-1] = 0
        for column in ("target", "cue", "frame"):
            tensors[f"schemas.pool.{column}"] = tensors[f"schemas.pool.{column}"][:-4].clone()

    rewrite_tensors(tmp_path, empty)
    with pytest.raises(ValueError, match="schemas of at least one target"):
        PACNet.from_pretrained(tmp_path)


@pytest.mark.parametrize("text", ["", "5", '{"tea": 1, "milk": 2}', "[1, 2]", '["a", "a"]', '"ab"'])
def test_names_that_are_no_list_of_different_names_are_refused(tmp_path, text: str):
    make_competing().save_pretrained(tmp_path)
    name = "schemas._extra_state"
    text_bytes = torch.tensor(list(text.encode()), dtype=torch.uint8)
    rewrite_tensors(tmp_path, lambda tensors: tensors.update({name: text_bytes}))
    with pytest.raises(ValueError, match="expected the tensors of a PACNet"):
        PACNet.from_pretrained(tmp_path)


def test_the_names_may_not_be_missing(tmp_path):
    make_competing().save_pretrained(tmp_path)
    rewrite_tensors(tmp_path, lambda tensors: tensors.pop("schemas._extra_state"))
    with pytest.raises(ValueError, match=r"CompetingSchemas, got \['_extra_state'\] missing"):
        PACNet.from_pretrained(tmp_path)


def test_a_contradiction_between_competing_schemas_is_not_saved(tmp_path):
    network = make_competing()
    network.schemas.visits.live("last")[0] = 99
    with pytest.raises(ValueError, match="visits within their episodes"):
        network.save_pretrained(tmp_path / "net")
    assert not (tmp_path / "net").exists()


def test_the_config_of_one_kind_does_not_read_the_tensors_of_the_other(tmp_path, checkpoint):
    make_competing().save_pretrained(tmp_path / "competing")
    config, _ = read_checkpoint(checkpoint)
    write_checkpoint(tmp_path / "competing", config, read_checkpoint(tmp_path / "competing")[1])
    with pytest.raises(ValueError, match=r"got \['blocks\.episode', .*missing.*visits"):
        PACNet.from_pretrained(tmp_path / "competing")


def test_the_checkpoint_that_ships_with_one_schema_a_node_still_loads():
    folder = Path(__file__).parents[2] / "checkpoints" / "postural_imitation"
    network = PACNet.from_pretrained(folder)
    assert isinstance(network.config.schemas, MotorSchemasConfig)
    percepts = network.sofm.prototypes
    recall = network.recall(percepts)
    assert recall.has_target.any()
    assert torch.equal(recall.schema, recall.winner.where(recall.has_target, torch.tensor(-1)))
