"""The joint PID, on second-order plants m q'' + c q' + load = torque whose answer is known."""

import copy
import json
import math
import re
from dataclasses import asdict

import pytest
import torch
from torch import Tensor

from pacnet.forward_models.pid import PIDConfig, PIDController
from pacnet.forward_models.protocol import ForwardModel

MASS, FRICTION = 0.7, 0.3  # [kg m^2], [N m s / rad]


def controller(kp=40.0, ki=0.0, kd=2.0, dt=0.01, integral_limit=1e3, torque_limit=1e6):
    config = PIDConfig(
        kp=(kp,),
        ki=(ki,),
        kd=(kd,),
        dt=dt,
        integral_limit=integral_limit,
        torque_limit=torque_limit,
    )
    return PIDController(config).double()


def random_batch(rows: int, joints: int, seed: int = 0, dtype=torch.float32) -> list[Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [torch.randn(rows, joints, generator=generator, dtype=dtype) for _ in range(5)]


def simulate(pid: PIDController, seconds: float, load: float = 0.0, held: float = 0.0):
    """Angles [T] of the plant stepped to 1 rad; for the first `held` seconds it cannot move."""
    dt, q, v = pid.config.dt, torch.zeros(1, 1).double(), torch.zeros(1, 1).double()
    angles = []
    for step in range(round(seconds / dt)):
        torque = pid.step(q, v, torch.ones_like(q))
        if step * dt >= held:
            v = v + dt * (torque - load - FRICTION * v) / MASS
            q = q + dt * v
        angles.append(q.item())
    return torch.tensor(angles)


def test_pd_step_response_is_the_closed_form_of_the_damped_oscillator():
    # m q'' + (c + kd) q' + kp q = kp r from rest, under-damped:
    # q(t) = r (1 - e^(-s t) (cos w t + s/w sin w t)), s = (c + kd)/2m, w^2 = kp/m - s^2.
    pid = controller(kp=40.0, kd=2.0)
    s = (FRICTION + 2.0) / (2 * MASS)
    w = math.sqrt(40.0 / MASS - s**2)
    target = torch.full((1, 1), 0.8).double()
    nothing = torch.zeros_like(target)

    def slope(state: Tensor) -> Tensor:
        q, v = state[:, :1], state[:, 1:]
        torque, _ = pid(q, v, target, nothing)
        return torch.cat([v, (torque - FRICTION * v) / MASS], dim=1)

    dt, state = 0.005, torch.zeros(1, 2).double()
    for step in range(1, 401):  # Runge-Kutta of order 4: the plant itself is right to 1e-8
        k1 = slope(state)
        k2 = slope(state + dt / 2 * k1)
        k3 = slope(state + dt / 2 * k2)
        k4 = slope(state + dt * k3)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        t = step * dt
        expected = 0.8 * (1 - math.exp(-s * t) * (math.cos(w * t) + s / w * math.sin(w * t)))
        assert state[0, 0].item() == pytest.approx(expected, abs=1e-7)


def test_pd_leaves_exactly_load_over_kp():
    angles = simulate(controller(kp=40.0, kd=8.0), seconds=12.0, load=5.0)
    assert 1.0 - angles[-1].item() == pytest.approx(5.0 / 40.0, abs=1e-9)


def test_integral_removes_the_error_and_carries_the_load():
    pid = controller(kp=40.0, ki=60.0, kd=8.0)
    angles = simulate(pid, seconds=18.0, load=5.0)
    assert angles[-1].item() == pytest.approx(1.0, abs=1e-9)
    assert pid.integral.item() == pytest.approx(5.0 / 60.0, abs=1e-9)  # ki * integral = load


def test_integral_clamp_bounds_windup():
    gains = {"kp": 40.0, "ki": 60.0, "kd": 8.0}
    loose = simulate(controller(**gains, integral_limit=10.0), seconds=8.0, held=3.0)
    tight = simulate(controller(**gains, integral_limit=0.1), seconds=8.0, held=3.0)
    prompt = simulate(controller(**gains, integral_limit=10.0), seconds=8.0)
    assert loose.max() - 1 > 1.0  # three seconds of error of 1 rad have piled up
    assert tight.max() - 1 < 0.2
    assert tight.max() - 1 <= prompt.max() - 1 + 0.05


def test_integral_and_torque_never_pass_their_limits():
    pid = controller(ki=60.0, integral_limit=0.25, torque_limit=7.0)
    rest, far = torch.zeros(1, 1).double(), torch.full((1, 1), 3.0).double()
    for sign in (1, -1):
        pid.reset()
        for _ in range(300):  # 3 s of 3 rad would be 9 rad s
            torque = pid.step(rest, rest, sign * far)
        assert pid.integral.item() == sign * 0.25
        assert torque.item() == sign * 7.0


def test_one_update_by_hand():
    config = PIDConfig(
        kp=(10.0, 20.0), ki=(2.0, 4.0), kd=(1.0, 0.5), dt=0.5, integral_limit=1.0, torque_limit=15.0
    )
    torque, integral = PIDController(config)(
        angles=torch.tensor([[1.0, 0.0]]),
        velocities=torch.tensor([[2.0, -1.0]]),
        targets=torch.tensor([[2.0, 0.5]]),
        integral=torch.tensor([[0.25, 0.9]]),
        target_velocities=torch.tensor([[3.0, 0.0]]),
    )
    # joint 0: e 1, integral .25 + .5 = .75: 10 + 1.5 + 1 = 12.5
    # joint 1: e .5, integral .9 + .25 -> 1: 10 + 4 + .5 = 14.5
    assert torque.tolist() == [[12.5, 14.5]]
    assert integral.tolist() == [[0.75, 1.0]]


def test_a_jump_of_the_target_gives_no_derivative_kick():
    pid = controller(kp=40.0, kd=100.0)
    rest = torch.zeros(1, 1).double()
    pid.step(rest, rest, rest)
    assert pid.step(rest, rest, torch.ones_like(rest)).item() == pytest.approx(40.0)


def test_rows_are_independent():
    config = PIDConfig(
        kp=(9.0, 4.0, 1.0),
        ki=(1.0, 2.0, 3.0),
        kd=(0.1, 0.2, 0.3),
        dt=0.01,
        integral_limit=1.0,
        torque_limit=10.0,
    )
    pid, batch = PIDController(config), random_batch(6, 3)
    torque, integral = pid(*batch)
    for row in range(6):
        one_torque, one_integral = pid(*(value[row : row + 1] for value in batch))
        assert torch.equal(one_torque[0], torque[row])
        assert torch.equal(one_integral[0], integral[row])


def test_forward_reads_only_and_step_remembers():
    pid = controller(ki=60.0)
    batch = random_batch(4, 1, dtype=torch.float64)
    before = [value.clone() for value in batch]
    first, second = pid(*batch), pid(*batch)
    assert all(torch.equal(one, other) for one, other in zip(first, second, strict=True))
    assert len(pid.integral) == 0
    assert all(torch.equal(one, other) for one, other in zip(batch, before, strict=True))
    once = pid.step(*batch[:3])
    assert not torch.equal(once, pid.step(*batch[:3]))
    pid.reset()
    assert torch.equal(once, pid.step(*batch[:3]))


def test_steps_are_forward_with_the_integral_threaded_through():
    pid, other = controller(ki=60.0), controller(ki=60.0)
    integral = torch.zeros(4, 1).double()
    for seed in range(5):
        angles, velocities, targets, wanted, _ = random_batch(4, 1, seed, torch.float64)
        torque, integral = other(angles, velocities, targets, integral, wanted)
        assert torch.equal(pid.step(angles, velocities, targets, wanted), torque)


def test_a_command_is_a_step_with_angles_and_velocities_side_by_side():
    # Joint 0: e 1, integral 1: 10 * 1 + 2 * 1 - 1 * 2 = 10. Joint 1: e .5, integral .5:
    # 20 * .5 + 4 * .5 - .5 * -1 = 12.5. A second time the integrals are 2 and 1: 12 and 14.5.
    config = PIDConfig(
        kp=(10.0, 20.0), ki=(2.0, 4.0), kd=(1.0, 0.5), dt=1.0, integral_limit=9.0, torque_limit=99.0
    )
    pid = PIDController(config)
    assert isinstance(pid, ForwardModel)
    states, targets = torch.tensor([[1.0, 0.0, 2.0, -1.0]]), torch.tensor([[2.0, 0.5]])
    first, second = pid.command(states, targets), pid.command(states, targets)
    assert first.action.tolist() == [[10.0, 12.5]]
    assert second.action.tolist() == [[12.0, 14.5]]
    assert first.has_action.tolist() == [True]
    pid.reset()
    assert pid.command(states, targets).action.tolist() == [[10.0, 12.5]]


@pytest.mark.parametrize(
    ("states", "targets", "message"),
    [
        (torch.zeros(1, 1), torch.zeros(1, 1), r"states .* \[rows, 2\] .* got shape \[1, 1\]"),
        (torch.zeros(1, 2), torch.zeros(1, 2), r"targets .* got shape \[1, 2\]"),
        (torch.zeros(1, 2), torch.zeros(2, 1), "equally many rows"),
        (None, torch.zeros(1, 1), "states .* got NoneType"),
    ],
)
def test_a_refused_command_changes_nothing(states, targets, message):
    pid = PIDController(controller(ki=60.0).config)
    pid.command(torch.zeros(1, 2), torch.ones(1, 1))
    before = pid.integral.clone()
    with pytest.raises(ValueError, match=message):
        pid.command(states, targets)
    assert torch.equal(pid.integral, before)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_module_moves_with_its_state(dtype):
    pid = PIDController(controller(ki=60.0).config)
    pid.step(*random_batch(4, 1)[:3])
    pid.to(dtype)
    torque, integral = pid(*random_batch(4, 1, dtype=dtype))
    assert torque.dtype == integral.dtype == pid.integral.dtype == dtype
    assert torch.isfinite(pid.step(*random_batch(4, 1, dtype=dtype)[:3])).all()
    assert all(value.is_meta for value in copy.deepcopy(pid).to("meta").buffers())


def test_the_episode_is_not_saved_and_the_config_survives_json():
    pid = controller(ki=60.0)
    pid.step(*random_batch(4, 1, dtype=torch.float64)[:3])
    assert set(pid.state_dict()) == {"kp", "ki", "kd"}
    assert PIDConfig(**json.loads(json.dumps(asdict(pid.config)))) == pid.config


def test_gradient_reaches_the_targets_and_stops_at_the_step_before():
    pid = controller(ki=60.0, dt=0.1)
    angles, velocities, targets, *_ = random_batch(2, 1, dtype=torch.float64)
    targets.requires_grad_()
    with torch.inference_mode():
        pid.step(angles, velocities, targets)
    for _ in range(2):
        (gradient,) = torch.autograd.grad(pid.step(angles, velocities, targets).sum(), targets)
        assert gradient.flatten().tolist() == pytest.approx([40.0 + 60.0 * 0.1] * 2)


@pytest.mark.parametrize(
    ("position", "value", "message"),
    [
        (0, torch.zeros(2, 3).double(), r"angles .* \[rows, 1\] .* got shape \[2, 3\]"),
        (0, torch.zeros(1).double(), r"angles .* got shape \[1\]"),
        (0, torch.zeros(0, 1).double(), r"angles .* got an empty one"),
        (0, [[0.0], [0.0]], "angles .* got list"),
        (1, torch.zeros(3, 1).double(), "equally many rows .* 'velocities': 3"),
        (2, torch.zeros(2, 1), "targets as a torch.float64 .* got dtype torch.float32"),
        (2, torch.full((2, 1), math.nan).double(), "expected finite targets"),
        (3, torch.full((2, 1), math.inf).double(), "expected finite integral"),
        (4, torch.zeros(2, 2).double(), "target_velocities as"),
    ],
)
def test_bad_input_is_refused(position, value, message):
    batch = random_batch(2, 1, dtype=torch.float64)
    batch[position] = value
    with pytest.raises(ValueError, match=message):
        controller()(*batch)


def test_a_refused_step_changes_nothing():
    pid = controller(ki=60.0)
    angles, velocities, targets, *_ = random_batch(2, 1, dtype=torch.float64)
    pid.step(angles, velocities, targets)
    before = pid.integral.clone()
    with pytest.raises(ValueError, match="expected finite targets"):
        pid.step(angles, velocities, targets * math.nan)
    with pytest.raises(ValueError, match="or a reset between"):
        pid.step(angles[:1], velocities[:1], targets[:1])
    assert torch.equal(pid.integral, before)


@pytest.mark.parametrize("angles", [0.5, None, [[0.0], [0.0]], torch.tensor(0.5).double()])
@pytest.mark.parametrize("steps", [0, 1])
def test_step_refuses_what_forward_refuses(angles, steps):
    pid = controller(ki=60.0)
    sound, velocities, targets, integral, _ = random_batch(2, 1, dtype=torch.float64)
    for _ in range(steps):
        pid.step(sound, velocities, targets)
    before = pid.integral.clone()
    with pytest.raises(ValueError, match="expected angles as") as refused:
        pid(angles, velocities, targets, integral)
    with pytest.raises(ValueError, match=f"^{re.escape(str(refused.value))}$"):
        pid.step(angles, velocities, targets)
    assert torch.equal(pid.integral, before)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("kp", (1.0, 2.0), "expected PIDConfig.ki to be one finite gain"),
        ("ki", (-1.0,), "PIDConfig.ki to be one finite gain"),
        ("kd", (math.nan,), "PIDConfig.kd to be"),
        ("dt", 0.0, "PIDConfig.dt > 0"),
        ("integral_limit", 0.0, "PIDConfig.integral_limit > 0"),
        ("torque_limit", math.nan, "PIDConfig.torque_limit > 0"),
        ("kp", "12", "PIDConfig.kp to be one finite gain .*, got '12'"),
        ("kp", None, "PIDConfig.kp to be one finite gain .*, got None"),
        ("ki", 2.0, "PIDConfig.ki to be one finite gain .*, got 2.0"),
        ("kd", ("1",), r"PIDConfig.kd to be one finite gain .*, got \('1',\)"),
        ("kd", (None,), r"PIDConfig.kd to be one finite gain .*, got \(None,\)"),
        ("dt", "0.01", "PIDConfig.dt > 0 and finite .*, got '0.01'"),
        ("integral_limit", None, "PIDConfig.integral_limit > 0 .*, got None"),
        ("torque_limit", (1.0,), r"PIDConfig.torque_limit > 0 .*, got \(1.0,\)"),
    ],
)
def test_bad_config_is_refused(field, value, message):
    fields = asdict(controller().config) | {field: value}
    with pytest.raises(ValueError, match=message):
        PIDConfig(**fields)
