"""What every module of pacnet keeps, and the growing map against an independent one in Python."""

from __future__ import annotations

import copy
import functools
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from pacnet import (
    NO_NODE,
    CompetingSchemas,
    CompetingSchemasConfig,
    HabituatingSOFM,
    MotorSchemas,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    PIDConfig,
    PIDController,
    SOFMConfig,
    SOFMEnsemble,
)
from pacnet.competition.winner_take_all import CompetitionConfig
from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.forward_models import fitting
from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.config import (
    AffineForwardModelConfig,
    KinematicModelConfig,
    MLPForwardModelConfig,
    TransitionMatrixConfig,
)
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix
from pacnet.kernels.engine import Engine
from pacnet.network.config import SchemaNetworkConfig
from pacnet.network.schema_network import SchemaNetwork
from pacnet.vision import Cameras, ImageEncoder, ImageEncoderConfig
from pacnet.vision.cameras_config import CamerasConfig

Tensors = tuple[Tensor, ...]
SAMPLES, DWELL = 32, 8
FIELDS = {
    "novelty_threshold": 0.6, "max_edge_age": 2, "neighbour_rate": 0.0625, "habituated_below": 0.6
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One module under contract.

    Attributes:
        make: an from_demonstrations one.
        learn: changes what it has learned, from `draw`n percepts [T, 2] and targets [T, 3].
        use: what it answers to such a pair, without learning.
        checks_input: whether it stands at the boundary and refuses another dtype.
        by_gradient: whether it has Parameters.
        freezes: whether it learns step by step, and nothing in eval mode. A fit from a whole data
            set is asked for by name, in either mode.
        on_cpu: whether it stays there: it looks at arrays.
    """

    make: Callable[[], nn.Module]
    learn: Callable[..., Tensors]
    use: Callable[..., Tensors]
    checks_input: bool = True
    by_gradient: bool = False
    freezes: bool = True
    on_cpu: bool = False


def draw(seed: int, dtype: torch.dtype = torch.float32) -> Tensors:
    """Percepts [T, 2] that dwell here and there, targets [T, 3]; exact in any float type."""
    generator = torch.Generator().manual_seed(seed)
    places = torch.randint(-3, 4, (SAMPLES // DWELL, 2), generator=generator) / 2
    jitter = torch.randint(-1, 2, (SAMPLES, 2), generator=generator) / 16
    targets = torch.randint(-8, 9, (SAMPLES, 3), generator=generator) / 8
    return (places.repeat_interleave(DWELL, dim=0) + jitter).to(dtype), targets.to(dtype)


def make_rows() -> GrowableRows:
    return GrowableRows({"point": Column((2,), torch.float32), "number": Column((), torch.int64)})


def learn_rows(rows: GrowableRows, percepts: Tensor, _targets: Tensor) -> Tensors:
    for number, percept in enumerate(percepts):
        rows.append({"point": percept, "number": number})
    rows.delete(torch.arange(0, len(rows), 3, device=percepts.device))
    return ()


def use_rows(rows: GrowableRows, _percepts: Tensor, _targets: Tensor) -> Tensors:
    return rows.live("point").clone(), rows.live("number").clone()


def map_config(preset: str) -> SOFMConfig:
    forgetting = {"forgetting_interval": 3} if preset == "paper" else {}
    return getattr(SOFMConfig, preset)(2, scale=(2.0, 1.0), **FIELDS, **forgetting)


def learn_map(sofm: HabituatingSOFM, percepts: Tensor, _targets: Tensor) -> Tensors:
    return tuple(sofm.observe(percepts))


def use_map(sofm: HabituatingSOFM, percepts: Tensor, _targets: Tensor) -> Tensors:
    return tuple(sofm(percepts))


def make_ensemble() -> SOFMEnsemble:
    return SOFMEnsemble(HabituatingSOFM(map_config(preset)) for preset in ("paper", "gwr"))


def learn_ensemble(ensemble: SOFMEnsemble, percepts: Tensor, _targets: Tensor) -> Tensors:
    return tuple(itertools.chain(*ensemble.observe([percepts, percepts[:-5]])))


def use_ensemble(ensemble: SOFMEnsemble, percepts: Tensor, _targets: Tensor) -> Tensors:
    return tuple(itertools.chain(*ensemble([percepts, percepts])))


def make_schemas(recall_by: str, budget: int | None = None) -> MotorSchemas:
    config = MotorSchemasConfig(3, percept_dimensions=2, recall_by=recall_by, budget=budget)
    return MotorSchemas(config)


def learn_schemas(schemas: MotorSchemas, percepts: Tensor, targets: Tensor) -> Tensors:
    while schemas.training and len(schemas) < 4:  # the map makes nodes when it learns
        schemas.add_node()
    episode = int(schemas.blocks.live("episode").max()) + 1 if len(schemas) else 0
    for sample, (percept, target) in enumerate(zip(percepts, targets, strict=True)):
        if len(schemas):
            node = sample * sample % len(schemas)
            schemas.write(node, target, percept, episode, habituated=sample % 5 > 0)
    return ()


def use_schemas(schemas: MotorSchemas, percepts: Tensor, _targets: Tensor) -> Tensors:
    schemas.reset()
    answers = [
        schemas.recall(sample % len(schemas), percept)
        for sample, percept in enumerate(percepts)
        if len(schemas)
    ]
    targets = [answer.target for answer in answers if answer is not None]
    positions = [answer.offset for answer in answers if answer is not None]
    return schemas.lengths.clone(), *targets, torch.tensor(positions)


def make_network(preset: str, recall_by: str) -> PACNet:
    schemas = MotorSchemasConfig(3, percept_dimensions=2, recall_by=recall_by)
    return PACNet(PACNetConfig(map_config(preset), schemas))


def learn_network(network: PACNet, percepts: Tensor, targets: Tensor) -> Tensors:
    return tuple(network.observe(percepts, targets, episode=int(network.episode) + 1))


def use_network(network: PACNet, percepts: Tensor, _targets: Tensor) -> Tensors:
    network.reset()
    recalled = network.recall(percepts)._replace(action=percepts)  # which is None
    return (*recalled, *network(percepts))


def competing_config() -> CompetingSchemasConfig:
    return CompetingSchemasConfig(
        3, percept_dimensions=2, schemas_per_node=2, same_schema_similarity=0.5, lookahead_samples=3
    )


def learn_competing(schemas: CompetingSchemas, percepts: Tensor, targets: Tensor) -> Tensors:
    while schemas.training and len(schemas) < 4:  # the map makes nodes when it learns
        schemas.add_node()
    episode = int(schemas.episodes.live("number")[-1]) + 1 if len(schemas.episodes) else 0
    schemas.begin(episode, f"behaviour {episode % 2}")
    for sample, (percept, target) in enumerate(zip(percepts, targets, strict=True)):
        node, habituated = sample // 3 % 4, sample % 5 > 0
        schemas.write(node, target, percept, activation=0.75, habituated=habituated)
    return ()


def use_competing(schemas: CompetingSchemas, percepts: Tensor, _targets: Tensor) -> Tensors:
    schemas.reset()
    nodes = range(4) if len(schemas) else [NO_NODE]
    answers = [
        schemas.recall(nodes[sample % len(nodes)], percept)
        for sample, percept in enumerate(percepts)
    ]
    given = [answer for answer in answers if answer is not None]
    places = [(answer.offset, answer.schema) for answer in given]
    return schemas.lengths.clone(), *(answer.target for answer in given), torch.tensor(places)


def make_competing_network(preset: str) -> PACNet:
    return PACNet(PACNetConfig(map_config(preset), competing_config()))


def learn_competing_network(network: PACNet, percepts: Tensor, targets: Tensor) -> Tensors:
    episode = int(network.episode) + 1
    return tuple(network.observe(percepts, targets, episode, f"behaviour {episode % 2}"))


def understand_and_recall(network: PACNet, percepts: Tensor, targets: Tensor) -> Tensors:
    recalled = use_network(network, percepts, targets)
    if len(network.schemas.blocks) == 0:
        return recalled
    return (*recalled, *network.recognise(percepts))


def make_controller() -> PIDController:
    config = PIDConfig(
        kp=(8.0, 4.0), ki=(2.0, 1.0), kd=(1.0, 0.5), dt=0.125, integral_limit=1.0, torque_limit=16.0
    )
    return PIDController(config)


def learn_controller(pid: PIDController, percepts: Tensor, targets: Tensor) -> Tensors:
    pid.reset()
    return tuple(pid.step(percepts, percepts, targets[:, :2]) for _ in range(3))


def use_controller(pid: PIDController, percepts: Tensor, targets: Tensor) -> Tensors:
    return pid(percepts, percepts, targets[:, :2], targets[:, 1:])


def lesson(percepts: Tensor, targets: Tensor) -> Tensors:
    """States [T, 2], actions [T, 1] and next states of a walk through the percepts, four times."""
    walk = percepts.repeat(4, 1)
    return walk[:-1], targets[:, :1].repeat(4, 1)[:-1], walk[1:]


def make_schema_network() -> SchemaNetwork:
    competition = CompetitionConfig(threshold=0.25, margin=0.125)
    return SchemaNetwork(SchemaNetworkConfig(2, 3, scale=(2.0, 1.0), competition=competition))


def learn_schema_network(network: SchemaNetwork, percepts: Tensor, targets: Tensor) -> Tensors:
    parts = zip(percepts.split(DWELL), targets.split(DWELL), strict=True)
    return (torch.tensor([network.add_schema(*part) for part in parts]),)


def use_schema_network(network: SchemaNetwork, percepts: Tensor, _targets: Tensor) -> Tensors:
    network.reset()
    recall = network.recall(percepts)
    return (*recall[:3], *recall.activity, *network(percepts))


CANDIDATES = ((-1.0,), (0.0,), (1.0,))


def make_mlp() -> MLPForwardModel:
    return MLPForwardModel(MLPForwardModelConfig(2, 1, CANDIDATES, hidden=(8,)))


def learn_mlp(model: MLPForwardModel, percepts: Tensor, targets: Tensor) -> Tensors:
    report = model.fit(*lesson(percepts, targets), seed=3)
    return report.validation_rows, report.r2


def make_matrix() -> TransitionMatrix:
    return TransitionMatrix(TransitionMatrixConfig(2, 1, CANDIDATES, clusters=4))


def learn_matrix(model: TransitionMatrix, percepts: Tensor, targets: Tensor) -> Tensors:
    return (torch.tensor(model.fit(*lesson(percepts, targets), seed=3).distortion).double(),)


def use_forward_model(
    model: MLPForwardModel | TransitionMatrix, percepts: Tensor, targets: Tensor
) -> Tensors:
    model.reset()
    selection = model.select(percepts[0], percepts[-1], targets[:, :1])
    predicted = model.predict(percepts, targets[:, :1]).detach()
    return predicted, *model.command(percepts, percepts.flip(0)), selection.action, selection.costs


def make_affine() -> AffineForwardModel:
    return AffineForwardModel(AffineForwardModelConfig(2, 3, lead=2, follows=(1, -1, -1)))


def learn_affine(model: AffineForwardModel, percepts: Tensor, targets: Tensor) -> Tensors:
    parts = percepts.split(2 * DWELL), targets.split(2 * DWELL)
    return (model.fit(*parts),)


def use_affine(model: AffineForwardModel, percepts: Tensor, targets: Tensor) -> Tensors:
    model.reset()
    command = model.command(percepts, percepts.flip(0))
    return *command, model(percepts, percepts, targets), model.residual(percepts, targets)


def make_body() -> KinematicModel:
    return KinematicModel(KinematicModelConfig(("shoulder", "elbow"), (0, 1)))


def learn_body(model: KinematicModel, percepts: Tensor, targets: Tensor) -> Tensors:
    """Fit an arm in a plane, of the two lengths that the targets give, and take over the fit."""
    angles = percepts.detach().double().repeat(4, 1)
    upper, fore = 1 + targets.detach().double().std(dim=0)[:2]
    total = angles.sum(dim=1)
    ways = [upper * angles[:, 0].cos() + fore * total.cos(), upper * angles[:, 0].sin()]
    places = torch.stack([*ways, fore * total.sin()], dim=1)
    turns = torch.stack([(total / 2).cos(), 0 * total, 0 * total, (total / 2).sin()], dim=1)
    fitted, fit = KinematicModel.fitted(model.config.joints, angles, places, turns)
    model.load_state_dict(fitted.state_dict())
    return (torch.tensor(fit.place_rms),)


def use_body(model: KinematicModel, percepts: Tensor, _targets: Tensor) -> Tensors:
    return tuple(model(percepts))


def make_encoder(kind: str) -> ImageEncoder:
    return ImageEncoder(ImageEncoderConfig(kind, 16, 24, 8, patch=5, features=768))


def picture(place: Tensor) -> Tensor:
    """A bright square on a ground that is the same each time."""
    seen = torch.randint(0, 90, (16, 24, 3), generator=torch.Generator().manual_seed(0)).byte()
    row, column = (place.float() * 2 + 4).round().long().tolist()
    seen[row : row + 5, column + 3 : column + 8] = torch.tensor([250, 180, 20]).byte()
    return seen


def learn_encoder(encoder: ImageEncoder, percepts: Tensor, targets: Tensor) -> Tensors:
    encoder.forget()
    for number, (percept, target) in enumerate(zip(percepts[::4], targets[::4], strict=True)):
        seen = picture(percept)
        encoder.add(seen, seen, torch.cat([percept.repeat(3), target[:2]]), number)
    encoder.fit()
    return (torch.tensor(encoder.told.error, dtype=torch.float64),)


def use_encoder(encoder: ImageEncoder, percepts: Tensor, _targets: Tensor) -> Tensors:
    looks = [encoder.look(picture(percept)) for percept in percepts]
    goals, doubts = [look.goals for look in looks], [look.doubt for look in looks]
    return *goals, torch.tensor(doubts, dtype=torch.float64)


def make_cameras() -> Cameras:
    encoders = (make_encoder("patches").config, make_encoder("none").config)
    return Cameras(CamerasConfig(("top", "side"), encoders, ("x", "y"), at_once=3, until=5))


def learn_cameras(cameras: Cameras, percepts: Tensor, targets: Tensor) -> Tensors:
    errors = [learn_encoder(one, percepts, targets)[0] for one in cameras.encoders.values()]
    return (torch.stack(errors),)


def use_cameras(cameras: Cameras, percepts: Tensor, _targets: Tensor) -> Tensors:
    sight = cameras.begin()
    seen = [sight([picture(percept).numpy()] * 2) for percept in percepts]
    return tuple(torch.from_numpy(one.goals).double() for one in seen)  # they are of float32


CASES = {
    "GrowableRows": Case(make_rows, learn_rows, use_rows, checks_input=False, freezes=False),
    "MotorSchemas-cue": Case(
        lambda: make_schemas("cue"), learn_schemas, use_schemas, checks_input=False
    ),
    "MotorSchemas-order": Case(
        lambda: make_schemas("order"), learn_schemas, use_schemas, checks_input=False
    ),
    "MotorSchemas-budget": Case(
        lambda: make_schemas("cue", budget=7), learn_schemas, use_schemas, checks_input=False
    ),
    "HabituatingSOFM-paper": Case(lambda: HabituatingSOFM(map_config("paper")), learn_map, use_map),
    "HabituatingSOFM-gwr": Case(lambda: HabituatingSOFM(map_config("gwr")), learn_map, use_map),
    "HabituatingSOFM-eager": Case(
        lambda: HabituatingSOFM(map_config("paper"), engine="eager"), learn_map, use_map
    ),
    "SOFMEnsemble": Case(make_ensemble, learn_ensemble, use_ensemble),
    "PACNet-paper-cue": Case(lambda: make_network("paper", "cue"), learn_network, use_network),
    "PACNet-gwr-order": Case(lambda: make_network("gwr", "order"), learn_network, use_network),
    "CompetingSchemas": Case(
        lambda: CompetingSchemas(competing_config()),
        learn_competing,
        use_competing,
        checks_input=False,
    ),
    "PACNet-paper-competing": Case(
        lambda: make_competing_network("paper"), learn_competing_network, understand_and_recall
    ),
    "PACNet-gwr-competing": Case(
        lambda: make_competing_network("gwr"), learn_competing_network, understand_and_recall
    ),
    "SchemaNetwork": Case(
        make_schema_network, learn_schema_network, use_schema_network, freezes=False
    ),
    "PIDController": Case(make_controller, learn_controller, use_controller),
    "MLPForwardModel": Case(
        make_mlp, learn_mlp, use_forward_model, by_gradient=True, freezes=False
    ),
    "AffineForwardModel": Case(make_affine, learn_affine, use_affine, freezes=False),
    "KinematicModel": Case(make_body, learn_body, use_body, checks_input=False, freezes=False),
    "TransitionMatrix": Case(make_matrix, learn_matrix, use_forward_model, freezes=False),
    **{
        f"ImageEncoder-{kind}": Case(
            functools.partial(make_encoder, kind),
            learn_encoder,
            use_encoder,
            checks_input=False,
            freezes=False,
            on_cpu=True,
        )
        for kind in ("patches", "pca", "none")
    },
    "Cameras": Case(
        make_cameras, learn_cameras, use_cameras, checks_input=False, freezes=False, on_cpu=True
    ),
}
CHECKING = [name for name, case in CASES.items() if case.checks_input]
FREEZING = [name for name, case in CASES.items() if case.freezes]
STARTS = ("from_demonstrations", "taught")


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


@pytest.fixture(params=STARTS)
def start(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(autouse=True)
def _short_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitting, "MAX_EPOCHS", 3)


@functools.cache
def taught(case: Case) -> nn.Module:
    module = case.make()
    case.learn(module, *draw(1))
    return module


def make(case: Case, start: str) -> nn.Module:
    """A fresh module, from_demonstrations or having learned one lesson."""
    return case.make() if start == "from_demonstrations" else copy.deepcopy(taught(case))


def snapshot(module: nn.Module) -> dict[str, Tensor]:
    """Everything learned; in its own memory, which `state_dict` alone does not promise."""
    return {name: tensor.clone() for name, tensor in module.state_dict().items()}


def assert_same(one: Iterable[Tensor], other: Iterable[Tensor]) -> None:
    """Equal to the last bit, NaN to NaN."""
    for a, b in zip(one, other, strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0, equal_nan=True)


def assert_same_state(module: nn.Module, state: dict[str, Tensor]) -> None:
    now = module.state_dict()
    assert list(now) == list(state)
    for name, tensor in state.items():
        assert torch.equal(now[name], tensor), name


def differs(module: nn.Module, state: dict[str, Tensor]) -> bool:
    return any(not torch.equal(module.state_dict()[name], state[name]) for name in state)


def test_the_same_input_gives_the_same_state_and_answers(case: Case, start: str):
    one, other = make(case, start), make(case, start)
    assert_same(case.learn(one, *draw(2)), case.learn(other, *draw(2)))
    assert_same_state(one, snapshot(other))
    assert_same(case.use(one, *draw(1)), case.use(other, *draw(1)))
    assert_same(case.use(one, *draw(1)), case.use(one, *draw(1)))


def test_using_changes_nothing_learned(case: Case, start: str):
    module = make(case, start)
    before = snapshot(module)
    case.use(module, *draw(1))
    assert_same_state(module, before)


def test_inputs_are_neither_changed_nor_kept(case: Case, start: str):
    module = make(case, start)
    for verb in (case.learn, case.use):
        given_tensors, before = draw(2), draw(2)
        verb(module, *given_tensors)
        assert_same(given_tensors, before)
        state = snapshot(module)
        for tensor in given_tensors:
            tensor.fill_(99)
        assert_same_state(module, state)


def test_answers_are_the_callers_own(case: Case, start: str):
    module = make(case, start)
    for answer in case.learn(module, *draw(2)):
        answer.fill_(1)
    state, expected = snapshot(module), [answer.clone() for answer in case.use(module, *draw(1))]
    for answer in case.use(module, *draw(1)):
        answer.fill_(1)
    assert_same_state(module, state)
    assert_same(case.use(module, *draw(1)), expected)


@pytest.mark.parametrize("target", STARTS)
def test_a_state_dict_makes_any_other_one_answer_and_learn_alike(
    case: Case, start: str, target: str
):
    source, loaded = make(case, start), case.make()
    if target == "taught":
        case.learn(loaded, *draw(5))
    # PID gains come from the config: zero them, so that only loading can bring them back.
    kept = loaded.state_dict().keys()
    for name, tensor in itertools.chain(loaded.named_buffers(), loaded.named_parameters()):
        if name in kept:
            tensor.data.zero_()
    state = source.state_dict()
    assert str(loaded.load_state_dict(state)) == "<All keys matched successfully>"
    assert_same_state(loaded, state)
    assert_same(case.use(loaded, *draw(1)), case.use(source, *draw(1)))
    assert_same(case.learn(loaded, *draw(4)), case.learn(source, *draw(4)))
    assert_same_state(loaded, snapshot(source))
    assert_same(case.use(loaded, *draw(1)), case.use(source, *draw(1)))


def damages(name: str, tensor: Tensor) -> dict[str, dict[str, Tensor] | None]:
    """What may have become of one tensor of a state: others in its place, or none at all."""
    damaged: dict[str, dict[str, Tensor] | None] = {
        "missing": None,
        "renamed": {f"{name}_": tensor},
        "deeper": {name: tensor[..., None]},
        "of another kind": {name: tensor.long() if tensor.is_floating_point() else tensor + 0.5},
    }
    if tensor.numel() and tensor.dtype not in (torch.bool, torch.uint8):  # bytes are text
        for place in (0, -1):
            spoilt = tensor.clone()
            spoilt.view(-1)[place] = torch.nan if tensor.is_floating_point() else -9
            damaged[f"spoilt at {place}"] = {name: spoilt}
    if tensor.dim():
        more = tensor.new_zeros(1, *tensor.shape[1:])
        damaged["one row more"] = {name: torch.cat([tensor, more])}
    return damaged


def is_refused(module: nn.Module, state: dict[str, Tensor], *, strict: bool) -> bool:
    try:
        module.load_state_dict(state, strict=strict)
    except ValueError as error:
        return str(error).startswith("expected ")
    return False


CHECKED = [
    name for name in CASES if name.startswith(("Aff", "Habit", "Kin", "Motor", "Comp", "PACNet"))
]


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("case", CHECKED, indirect=True)
def test_a_damaged_state_is_refused_before_anything_changes(case: Case, strict: bool):
    module, state = case.make(), make(case, "taught").state_dict()
    case.learn(module, *draw(5))
    before, answers = snapshot(module), case.use(module, *draw(1))
    for name, tensor in state.items():
        rest = {other: value for other, value in state.items() if other != name}
        for how, others in damages(name, tensor).items():
            assert is_refused(module, rest | (others or {}), strict=strict), f"{name} {how}"
            assert_same_state(module, before)
    if strict:
        with pytest.raises(ValueError, match=r"none missing, \['more'\] extra"):
            module.load_state_dict(state | {"more": torch.zeros(1)})
        with pytest.raises(ValueError, match="missing, none extra"):
            module.load_state_dict({})
    assert_same_state(module, before)
    assert_same(case.use(module, *draw(1)), answers)
    module.load_state_dict(state, strict=strict)
    assert_same_state(module, state)


def test_what_was_loaded_shares_no_memory(case: Case):
    source, loaded = make(case, "taught"), case.make()
    state = source.state_dict()
    loaded.load_state_dict(state)
    before, kept = snapshot(source), {name: tensor.clone() for name, tensor in state.items()}
    for buffer in loaded.buffers():
        buffer.fill_(7)
    assert_same_state(source, before)
    for name, tensor in state.items():
        assert torch.equal(tensor, kept[name]), name


def test_a_state_dict_holds_tensors_alone_and_nothing_dead(case: Case, start: str):
    state = make(case, start).state_dict()
    for name, tensor in state.items():
        assert type(tensor) is Tensor, name
        assert not tensor.requires_grad, name
        assert tensor.untyped_storage().nbytes() == tensor.nbytes, name  # no spare rows behind it


def test_only_what_a_gradient_teaches_is_a_parameter_and_nothing_keeps_a_graph(case: Case):
    module = case.make()
    percepts, targets = draw(1)
    if case.make is not make_rows:  # which hold what they are given
        percepts.requires_grad_(), targets.requires_grad_()
    case.learn(module, percepts, targets)
    case.use(module, percepts, targets)
    assert bool(list(module.parameters())) == case.by_gradient
    for name, buffer in module.named_buffers():
        assert not buffer.requires_grad, name
        assert buffer.grad_fn is None, name


def test_a_deep_copy_goes_its_own_way(case: Case, start: str):
    original = make(case, start)
    twin = copy.deepcopy(original)
    before = snapshot(original)
    case.learn(twin, *draw(2))
    assert_same_state(original, before)
    learned = snapshot(twin)
    if case.make is not make_controller:
        assert differs(twin, before)
    case.learn(original, *draw(2))
    assert_same_state(original, learned)
    case.learn(original, *draw(4))
    assert_same_state(twin, learned)
    twin.load_state_dict(before)  # the copy's own hooks, not the original's
    assert_same_state(twin, before)


@pytest.mark.parametrize("case", FREEZING, indirect=True)
def test_eval_mode_freezes_everything_learned(case: Case, start: str):
    module = make(case, start).eval()
    before = snapshot(module)
    case.learn(module, *draw(2))
    assert_same_state(module, before)
    twin = make(case, start)
    assert_same(case.learn(module.train(), *draw(4)), case.learn(twin, *draw(4)))
    assert_same_state(module, snapshot(twin))


def test_double_precision_is_accepted_and_stays(case: Case, start: str):
    single, module = make(case, start), make(case, start).double()
    case.learn(single, *draw(2))
    case.learn(module, *draw(2, torch.float64))
    answers = case.use(module, *draw(1, torch.float64))
    for answer, expected in zip(answers, case.use(single, *draw(1)), strict=True):
        assert not answer.is_floating_point() or answer.dtype == torch.float64
        torch.testing.assert_close(answer.float(), expected.float(), equal_nan=True)
    for name, tensor in module.state_dict().items():
        assert not tensor.is_floating_point() or tensor.dtype == torch.float64, name
    module.load_state_dict(single.state_dict())
    for name, tensor in module.state_dict().items():
        assert not tensor.is_floating_point() or tensor.dtype == torch.float64, name
        torch.testing.assert_close(tensor, single.state_dict()[name].to(tensor.dtype))


@pytest.mark.parametrize("verb", ["learn", "use"])
@pytest.mark.parametrize("case", CHECKING, indirect=True)
def test_another_dtype_is_refused_by_name_before_anything_changes(
    case: Case, start: str, verb: str
):
    for wanted, other in ((torch.float32, torch.float64), (torch.float64, torch.float32)):
        module = make(case, start).to(wanted)
        before = snapshot(module)
        with pytest.raises(ValueError, match=f"as a {wanted} tensor.*got dtype {other}"):
            getattr(case, verb)(module, *draw(2, other))
        assert_same_state(module, before)


def test_using_under_inference_mode_leaves_it_able_to_learn(case: Case, start: str):
    module, twin = make(case, start), make(case, start)
    with torch.inference_mode():
        answers = case.use(module, *draw(1))
        module.state_dict()
    assert_same(answers, case.use(twin, *draw(1)))
    assert_same(case.learn(module, *draw(2)), case.learn(twin, *draw(2)))
    assert_same_state(module, snapshot(twin))


@pytest.mark.parametrize("case", CHECKING, indirect=True)
def test_learning_under_inference_mode_leaves_it_able_to_learn(case: Case, start: str):
    module, twin = make(case, start), make(case, start)
    with torch.inference_mode():
        case.learn(module, *draw(2))
    case.learn(twin, *draw(2))
    assert_same(case.learn(module, *draw(4)), case.learn(twin, *draw(4)))
    assert_same_state(module, snapshot(twin))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_cuda_device_agrees():
    cases = [case for case in CASES.values() if not case.on_cpu]
    for case, start in itertools.product(cases, STARTS):
        here, there = make(case, start), make(case, start).cuda()
        answers = [*case.learn(there, *to_cuda(draw(2))), *case.use(there, *to_cuda(draw(1)))]
        expected = [*case.learn(here, *draw(2)), *case.use(here, *draw(1))]
        for name, tensor in there.state_dict().items():
            assert tensor.is_cuda, name
            answers.append(tensor)
            expected.append(here.state_dict()[name])
        for one, other in zip(answers, expected, strict=True):
            torch.testing.assert_close(one.cpu(), other, equal_nan=True)


def to_cuda(tensors: Tensors) -> Tensors:
    return tuple(tensor.cuda() for tensor in tensors)


# The growing map against an independent one: nodes as objects, edges as pairs of them, no tensors.


class TooCloseError(Exception):
    """A decision that rounding could turn; what follows it cannot be compared."""


CLOSE = 1e-5
EVENTS = ("inserted", "ignored", "dishabituated", "deleted")


class Node:
    """A prototype; two of them are never equal, wherever they stand."""

    def __init__(self, place: list[float]) -> None:
        self.place, self.habituation, self.asleep_since = place, 1.0, None


class PlainMap:
    """The paper's three cases, and the Grow-When-Required step, in Python's own doubles."""

    def __init__(self, config: SOFMConfig, gwr: bool) -> None:
        self.config, self.gwr = config, gwr
        self.nodes: list[Node] = []
        self.ages: dict[frozenset[Node], int] = {}
        self.clock, self.ties = 0, 0

    def step(self, percept: list[float]) -> dict[str, object]:
        """Learn one percept; return the fields of an `Observation` for it."""
        self.clock += 1
        assert self.config.scale is not None
        x = [value * factor for value, factor in zip(percept, self.config.scale, strict=True)]
        if not self.nodes:
            self.nodes.append(Node(x))
            return self.report(None, None, 0.0, novelty=True, inserted=True)
        ranked = self.rank(x)
        best, second = ranked[0], ranked[1] if len(ranked) > 1 else None
        activation = math.exp(-math.dist(best.place, x))
        novelty = self.less(activation, self.config.novelty_threshold)
        fields = self.report(best, second, activation, novelty)
        fields["dishabituated"] = self.wake(best)  # a matter of time alone
        if novelty and (not self.gwr or self.sleeps(best)):
            self.insert(x, best, second)
            fields["inserted"] = True
            return fields
        if self.sleeps(best) and not self.gwr:
            return fields | {"attended": False, "ignored": True}
        if second is not None:
            self.ages[frozenset((best, second))] = 0
        others = [node for node in self.nodes if frozenset((best, node)) in self.ages]
        self.fire(best, x, self.config.winner_rate, self.config.winner_tau)
        for node in others:
            self.wake(node)
            if self.gwr or not self.sleeps(node):
                self.fire(node, x, self.config.neighbour_rate, self.config.neighbour_tau)
        fields["deleted"] = self.prune(best)
        return fields

    def report(
        self,
        best: Node | None,
        second: Node | None,
        activation: float,
        novelty: bool,
        inserted: bool = False,
    ) -> dict[str, object]:
        """Return the fields for a percept that the map attends to."""
        numbers = [NO_NODE if node is None else self.nodes.index(node) for node in (best, second)]
        return {
            "winner": numbers[0], "runner_up": numbers[1], "activation": activation,
            "novelty": novelty, "attended": True, "inserted": inserted, "ignored": False,
            "dishabituated": False, "deleted": 0,
        }  # fmt: skip

    def rank(self, x: list[float]) -> list[Node]:
        """Nearest first; Python's sort is stable, so that of equal ones the oldest is first."""
        ranked = sorted(self.nodes, key=lambda node: math.dist(node.place, x))
        for one, other in itertools.pairwise(ranked[:3]):
            gap = math.dist(other.place, x) - math.dist(one.place, x)
            few_bits = all(64 * v == round(64 * v) for v in one.place + other.place)
            if gap < CLOSE and not (gap == 0 and few_bits):
                raise TooCloseError
            self.ties += gap == 0
        return ranked

    @staticmethod
    def less(one: float, other: float) -> bool:
        """Compares what rounding reaches, or gives up."""
        if abs(one - other) < CLOSE:
            raise TooCloseError
        return one < other

    def sleeps(self, node: Node) -> bool:
        """Whether it is fully habituated."""
        return self.less(node.habituation, self.config.habituated_below)

    def wake(self, node: Node) -> bool:
        """Dishabituates a node that has slept for the interval, and says whether it did."""
        interval, since = self.config.forgetting_interval, node.asleep_since
        if interval is None or since is None or self.clock < since + interval:
            return False
        node.habituation, node.asleep_since = 1.0, None
        return True

    def fire(self, node: Node, x: list[float], rate: float, tau: float) -> None:
        """Moves; then one firing: tau h' = alpha (1 - h) - 1 solved one unit of time on."""
        step = rate * (node.habituation if self.gwr else 1.0)
        node.place = [(1 - step) * w + step * v for w, v in zip(node.place, x, strict=True)]
        fading = math.exp(-self.config.alpha / tau)
        node.habituation = (
            1.0 - (1.0 - node.habituation) * fading - (1.0 - fading) / self.config.alpha
        )
        if self.sleeps(node) and node.asleep_since is None:
            node.asleep_since = self.clock

    def insert(self, x: list[float], best: Node, second: Node | None) -> None:
        """At the percept beside the best; or half way, in place of the edge to the second."""
        if self.gwr:
            node = Node([(w + v) / 2 for w, v in zip(best.place, x, strict=True)])
            if second is not None:
                self.ages.pop(frozenset((best, second)), None)
                self.ages[frozenset((node, second))] = 0
        else:
            node = Node(x)
        self.nodes.append(node)
        self.ages[frozenset((node, best))] = 0

    def prune(self, best: Node) -> int:
        """Ages the edges of the best, drops old ones, then bare nodes; says how many of these."""
        self.ages = {pair: age + (best in pair) for pair, age in self.ages.items()}
        young = {pair: a for pair, a in self.ages.items() if a <= self.config.max_edge_age}
        if len(young) == len(self.ages):
            return 0
        self.ages = young
        before = len(self.nodes)
        self.nodes = [node for node in self.nodes if any(node in pair for pair in young)]
        return before - len(self.nodes)

    def edges(self) -> dict[tuple[int, ...], int]:
        """Numbers of the ends -> age."""
        return {
            tuple(sorted(self.nodes.index(node) for node in pair)): age
            for pair, age in self.ages.items()
        }


@st.composite
def lessons(draw_value: st.DrawFn) -> tuple[bool, SOFMConfig, list[list[float]]]:
    """A preset, a config of it, and percepts on a coarse grid, where equal distances abound."""
    gwr = draw_value(st.booleans())
    dimensions = draw_value(st.integers(1, 3))
    options = {
        "scale": st.tuples(*[st.sampled_from([0.5, 1.0, 2.0])] * dimensions),
        "novelty_threshold": st.sampled_from([0.1, 0.3, 0.55]),
        "winner_rate": st.sampled_from([0.25, 0.5, 1.0]),
        "neighbour_rate": st.sampled_from([0.0, 0.125, 0.5]),
        "habituated_below": st.sampled_from([0.2, 0.6, 0.8]),
        "winner_tau": st.sampled_from([1.5, 3.33]),
        "neighbour_tau": st.sampled_from([4.0, 14.3]),
        "max_edge_age": st.integers(1, 3),
    }
    if not gwr:
        options["forgetting_interval"] = st.sampled_from([2, 3, 5, None])
    fields = {name: draw_value(option) for name, option in options.items()}
    preset = SOFMConfig.gwr if gwr else SOFMConfig.paper
    coordinate = st.integers(-2, 2).map(float)
    percept = st.lists(coordinate, min_size=dimensions, max_size=dimensions)
    places = draw_value(st.lists(percept, min_size=3, max_size=6))
    stays = st.tuples(st.sampled_from(places), st.integers(1, 3))
    order = draw_value(st.lists(stays, min_size=12, max_size=24))
    return gwr, preset(dimensions, **fields), [place for place, stay in order for _ in range(stay)]


def assert_agree(sofm: HabituatingSOFM, plain: PlainMap) -> None:
    ends, age = sofm.edges.live("ends").tolist(), sofm.edges.live("age").tolist()
    assert dict(zip(map(tuple, ends), age, strict=True)) == plain.edges()
    places = [node.place for node in plain.nodes]
    habituation = [node.habituation for node in plain.nodes]
    assert sofm.nodes.live("prototype").flatten().tolist() == pytest.approx(
        [value for place in places for value in place], abs=2e-6
    )
    assert sofm.habituation.tolist() == pytest.approx(habituation, abs=1e-6)
    assert sofm.nodes.live("habituated_at").tolist() == [
        NO_NODE if node.asleep_since is None else node.asleep_since for node in plain.nodes
    ]


@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_the_map_equals_a_plain_one_on_random_lessons(engine: Engine):
    happened = Counter()

    @settings(max_examples=40, derandomize=True, deadline=None, database=None)
    @given(lessons())
    def check(lesson: tuple[bool, SOFMConfig, list[list[float]]]) -> None:
        gwr, config, percepts = lesson
        sofm, plain = HabituatingSOFM(config, engine), PlainMap(config, gwr)
        for percept in percepts:
            try:
                expected = plain.step(percept)
            except TooCloseError:
                return
            record = sofm.observe(torch.tensor([percept]))
            got = {name: value.item() for name, value in record._asdict().items()}
            assert got == expected | {"activation": pytest.approx(expected["activation"], abs=1e-6)}
            assert_agree(sofm, plain)
            happened["gwr" if gwr else "paper"] += 1
            happened.update({name: int(got[name]) for name in EVENTS})
        happened["ties"] += plain.ties

    check()
    for name in ("paper", "gwr", "ties", *EVENTS):
        assert happened[name] > 0, name
