"""What a user would pick instead: replay, neighbours, local regression, and small networks.

All but replay see places relative to one another, in units of their standard deviation, so that
what was shown in one place can be used in another.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from benchmarks.metaworld.features import Array, Indices, relative
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation.neighbours import NearestNeighbours

LOCAL = 20  # neighbours of the local regression
RIDGE = 1e-2  # of the mean variance of its inputs
CANDIDATES = 10  # neighbours that DARP compares
WIDTH, STEPS, BATCH = 128, 2_000, 256  # of a network's hidden layers; of its training
_STILL = 1e-5  # standard deviation below which a dimension does not move


class Frames:
    """All frames of some demonstrations, centred and scaled.

    A dimension that does not move has the median factor of the others.

    Attributes:
        rows: `[N, D]`.
        actions: `[N, 4]`.
    """

    def __init__(self, rows: Array, actions: Array) -> None:
        rows, deviations = rows.astype(np.float64), rows.std(axis=0, dtype=np.float64)
        moves = deviations >= _STILL
        factors = 1 / np.where(moves, deviations, 1)
        self._factors = np.where(moves, factors, np.median(factors[moves]) if moves.any() else 1)
        self._centre = rows.mean(axis=0)
        self.rows, self.actions = self.scaled(rows), actions.astype(np.float64)

    @classmethod
    def relative_of(cls, demonstrations: Demonstrations) -> Frames:
        """Return the frames of demonstrations, with places relative to one another."""
        rows = [relative(shown.percepts.numpy()) for shown in demonstrations]
        return cls(np.concatenate(rows), _actions_of(demonstrations))

    def scaled(self, rows: Array) -> Array:
        """Return rows `[..., D]` as those kept are."""
        return (rows - self._centre) * self._factors

    def nearest(self, scaled: Array, k: int) -> Indices:
        """Return the indices of the `k` rows nearest to one `[D]`, in no order; all if fewer."""
        if k >= len(self.rows):
            return np.arange(len(self.rows))
        apart = self.rows - scaled
        return np.argpartition(np.einsum("nd,nd->n", apart, apart), k - 1)[:k]


class Nearest:
    """The action of the nearest frame."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all frames."""
        parts = [
            _as_demonstration(relative(shown.percepts.numpy()), shown.action)
            for shown in demonstrations
        ]
        names = {"relative": tuple(map(str, range(parts[0].state.shape[1])))}
        names["action"] = demonstrations.action_names
        self._neighbours = NearestNeighbours(1).fit(
            Demonstrations(demonstrations.fps, names, tuple(parts))
        )

    def reset(self) -> None:
        """Do nothing: it remembers nothing."""

    def act(self, percept: Array) -> Array:
        """Return the action `[4]` at a percept `[D]`."""
        query = _as_demonstration(relative(percept)[None], torch.zeros(1, 4))
        return self._neighbours.predict(query)[0]


class Replay:
    """The actions of the demonstration that begins most alike, whatever happens."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all actions and the first percepts."""
        rows = [shown.percepts.numpy() for shown in demonstrations]
        self._frames = Frames(np.concatenate(rows), _actions_of(demonstrations))
        self._starts = np.stack([self._frames.scaled(one[0]) for one in rows])
        self._actions = [shown.action.numpy() for shown in demonstrations]

    def reset(self) -> None:
        """Choose anew at the next percept."""
        self._chosen: Array | None = None
        self._now = 0

    def act(self, percept: Array) -> Array:
        """Return the next action `[4]`, the last one once the demonstration is over."""
        if self._chosen is None:
            apart = np.square(self._starts - self._frames.scaled(percept)).sum(axis=1)
            self._chosen = self._actions[int(apart.argmin())]
        action = self._chosen[min(self._now, len(self._chosen) - 1)]
        self._now += 1
        return action


class LocalRegression:
    """A linear regression over the nearest frames, the nearer the more they count."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all frames."""
        self._frames = Frames.relative_of(demonstrations)

    def reset(self) -> None:
        """Do nothing: it remembers nothing."""

    def act(self, percept: Array) -> Array:
        """Return the action `[4]` at a percept `[D]`."""
        query = self._frames.scaled(relative(percept))
        near = self._frames.nearest(query, LOCAL)
        apart = self._frames.rows[near] - query
        squares = np.square(apart).sum(axis=1)
        weights = np.exp(-2 * squares / max(squares.max(), 1e-12))
        return regress(apart, self._frames.actions[near], weights / weights.sum())


def regress(inputs: Array, outputs: Array, weights: Array, ridge: float = RIDGE) -> Array:
    """Return the value `[U]` at zero of a weighted ridge regression.

    Args:
        inputs: `[K, D]`.
        outputs: `[K, U]`.
        weights: `[K]`, of sum 1.
        ridge: penalty on slopes, of the mean variance of an input.
    """
    middle, height = weights @ inputs, weights @ outputs
    centred = inputs - middle
    covariance = (centred.T * weights) @ centred
    penalty = ridge * max(float(np.trace(covariance)) / len(covariance), 1e-12)
    slopes = np.linalg.solve(
        covariance + penalty * np.eye(len(covariance)),
        (centred.T * weights) @ (outputs - height),
    )
    return height - middle @ slopes


class Network:
    """A perceptron of two hidden layers whose outputs are averaged over neighbours.

    It is trained by torch and read by NumPy, which is faster for a single percept.
    """

    def fit(self, inputs: Array, actions: Array, seed: int = 0) -> Network:
        """Learn actions `[N, U]` from inputs `[N, K, D]`; return itself."""
        random = torch.Generator().manual_seed(seed)
        x, y = torch.tensor(inputs, dtype=torch.float32), torch.tensor(actions).float()
        with torch.random.fork_rng([]):
            torch.manual_seed(seed)
            layers = [nn.Linear(x.shape[-1], WIDTH), nn.Linear(WIDTH, WIDTH)]
            layers.append(nn.Linear(WIDTH, y.shape[-1]))
        net = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])
        optimizer = torch.optim.AdamW(net.parameters(), 1e-3, weight_decay=1e-4)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
        for _ in range(STEPS):
            rows = torch.randint(len(x), (min(BATCH, len(x)),), generator=random)
            loss = (net(x[rows]).mean(dim=1) - y[rows]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
        self._layers = [(m.weight.detach().numpy().T, m.bias.detach().numpy()) for m in layers]
        return self

    def predict(self, inputs: Array) -> Array:
        """Return the action `[U]` at one input `[K, D]`."""
        hidden = inputs.astype(np.float32)
        for weight, bias in self._layers[:-1]:
            hidden = np.maximum(hidden @ weight + bias, 0)
        weight, bias = self._layers[-1]
        return (hidden @ weight + bias).mean(axis=0)


class BehaviourCloning:
    """A network from the percept to the action."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Train the network."""
        self._frames = Frames.relative_of(demonstrations)
        self._network = Network().fit(self._frames.rows[:, None], self._frames.actions)

    def reset(self) -> None:
        """Do nothing: it remembers nothing."""

    def act(self, percept: Array) -> Array:
        """Return the action `[4]` at a percept `[D]`."""
        return self._network.predict(self._frames.scaled(relative(percept))[None])


class NeighbourDifferences:
    """A network from each of the nearest frames and the difference to it, then averaged.

    Difference-aware retrieval as in DARP: its inputs are a neighbour, the neighbour's action and
    how the percept differs from it. In training a frame is not its own neighbour.
    """

    def learn(self, demonstrations: Demonstrations) -> None:
        """Train the network on every frame and the frames nearest to it."""
        self._frames = Frames.relative_of(demonstrations)
        rows = torch.from_numpy(self._frames.rows)
        apart = torch.cdist(rows, rows).fill_diagonal_(torch.inf)
        near = apart.topk(min(CANDIDATES, len(rows) - 1), largest=False).indices.numpy()
        inputs = self._compared(self._frames.rows[:, None], near)
        self._network = Network().fit(inputs, self._frames.actions)

    def reset(self) -> None:
        """Do nothing: it remembers nothing."""

    def act(self, percept: Array) -> Array:
        """Return the action `[4]` at a percept `[D]`."""
        query = self._frames.scaled(relative(percept))
        return self._network.predict(self._compared(query, self._frames.nearest(query, CANDIDATES)))

    def _compared(self, queries: Array, near: Indices) -> Array:
        """Return what the network sees, `[..., K, 2 D + 4]`, of neighbours `[..., K]`."""
        rows = self._frames.rows[near]
        return np.concatenate([rows, self._frames.actions[near], queries - rows], axis=-1)


def _actions_of(demonstrations: Demonstrations) -> Array:
    """Return all actions `[N, 4]`."""
    return torch.cat([shown.action for shown in demonstrations]).numpy()


def _as_demonstration(rows: Array, actions: torch.Tensor) -> Demonstration:
    """Return rows `[T, D]` and actions `[T, 4]` as a demonstration."""
    state = torch.from_numpy(np.asarray(rows, np.float32))
    return Demonstration(0, "", state, torch.empty(len(rows), 0), actions)
