"""One thread acts while another learns: on what was known before a lesson, or on all after it."""

from __future__ import annotations

import contextlib
import copy
import functools
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pacnet import (
    CompetingSchemasConfig,
    HabituatingSOFM,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    SOFMConfig,
)
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator

NAMES = {"observation.state": ("x", "y"), "observation.glass": ("z",), "action": ("u", "v")}
KINDS = ("cue", "order", "competing")
FRAMES = 40
EPISODES = ((3, 9, 15), (20, 26, 32), (39, 2, 39))  # frames of some episodes that are acted in


def lesson(number: int, rows: int = FRAMES) -> tuple[Tensor, Tensor]:
    """One of three ways along a circle, each time with other noise and other targets."""
    kind = number % 3
    phase = torch.linspace(0, 2 * math.pi, rows)
    noise = 0.03 * torch.randn(rows, 3, generator=torch.Generator().manual_seed(number))
    percepts = torch.stack([phase.sin(), phase.cos(), torch.full_like(phase, kind // 2)], dim=1)
    targets = torch.stack([phase + number, (1 + kind) * phase], dim=1)
    return percepts + noise, targets


def demonstrations(*numbers: int) -> Demonstrations:
    episodes = []
    for number in numbers:
        percepts, targets = lesson(number)
        parts = percepts[:, :2], percepts[:, 2:], targets
        episodes.append(Demonstration(number, f"way {number % 3}", *parts))
    return Demonstrations(50, NAMES, tuple(episodes), "ways")


def make_map(engine: str) -> HabituatingSOFM:
    sofm = HabituatingSOFM(SOFMConfig.paper(3, novelty_threshold=0.7, max_edge_age=3), engine)
    sofm.observe(lesson(0)[0])
    return sofm


def make_network(kind: str) -> PACNet:
    schemas = {
        "cue": MotorSchemasConfig(2, 3),
        "order": MotorSchemasConfig(2, 3, recall_by="order"),
        "competing": CompetingSchemasConfig(2, 3),
    }[kind]
    network = PACNet(PACNetConfig(SOFMConfig.paper(3, novelty_threshold=0.6), schemas))
    teach(network, 0)
    return network


def make_imitator() -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations(0, 1, 2))
    imitator.learn(demonstrations(0))
    return imitator


def teach(model: Any, number: int) -> None:
    """One lesson; of a network the map watches first, which is a lesson of its own."""
    if isinstance(model, Imitator):
        model.learn(demonstrations(number))
    elif isinstance(model, PACNet):
        percepts, targets = lesson(number)
        model.attend(percepts)
        model.observe(percepts, targets, number, f"way {number % 3}")
    else:
        model.observe(lesson(number)[0])


def plain(value: Any) -> Any:
    """In a form that can be compared, to the bit."""
    if isinstance(value, Tensor | np.ndarray):
        return np.asarray(value).tobytes()
    return tuple(map(plain, value)) if isinstance(value, tuple | list) else repr(value)


def state_of(model: nn.Module) -> dict[str, Any]:
    return {name: plain(tensor) for name, tensor in model.state_dict().items()}


@contextmanager
def beside(*works: Callable[[], object]) -> Iterator[list[BaseException]]:
    """Run each again and again in a thread of its own; what one raises is raised at the end.

    The interpreter goes from thread to thread as often as it can, so that it does at every place.

    Yields:
        What was raised so far.
    """
    over, errors = threading.Event(), []

    def run(work: Callable[[], object]) -> None:
        try:
            while not over.is_set():
                work()
        except BaseException as error:  # for the test's own thread to raise
            errors.append(error)

    threads = [threading.Thread(target=run, args=(work,), daemon=True) for work in works]
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for thread in threads:
            thread.start()
        yield errors
    finally:
        over.set()
        for thread in threads:
            thread.join()
        sys.setswitchinterval(usual)  # last: a thread that learns sets it back to what it found
    if errors:
        raise errors[0]


def wait_for(errors: list[BaseException], more: int, *taken: list[Any]) -> None:
    """Waits until so many more answers have come to each list, or none will."""
    goals = [len(answers) + more for answers in taken]
    while any(map(lambda answers, goal: len(answers) < goal, taken, goals)) and not errors:
        time.sleep(1e-4)


def assert_ascending(answers: list[Any], known: list[Any]) -> None:
    """Each is a known one, none of fewer lessons than one before it, the last one of all."""
    least = 0
    for answer in answers:
        assert answer in known[least:]
        least = known.index(answer, least)
    assert answers[-1] == known[-1]


# The Imitator: each answer is of one number of lessons, and an episode goes on over a lesson.


def acted(imitator: Imitator, frames: tuple[int, ...], taught: int = 0, lesson_at: int = 0) -> Any:
    """What it does in an episode of some frames: at each the action, what is followed, how far.

    Args:
        imitator: that acts.
        frames: of the episode.
        taught: number of a lesson that comes before the step at `lesson_at`; 0 for none.
        lesson_at: 0 for never.
    """
    imitator.reset()
    percepts, answers = lesson(frames[0] % 3, FRAMES)[0], []
    for place, frame in enumerate(frames):
        if lesson_at and place == lesson_at:
            teach(imitator, taught)
        step = imitator.step(percepts[frame])
        answers.append(plain((step.action, step.followed, step.progress)))
    return answers


def stories(imitator: Imitator, number: int, frames: tuple[int, ...]) -> list[Any]:
    """What may be done in an episode that begins after so many lessons: the next one may come."""
    later = range(1, len(frames))
    return [
        acted(imitator, frames),
        *(acted(copy.deepcopy(imitator), frames, number + 1, place) for place in later),
    ]


def imitate_beside(lessons: int, steps: int) -> None:
    """Take so many steps while so many demonstrations are learned, and compare each episode.

    It must be one of a reference that learned k demonstrations, of which the last one may have come
    in the middle, and k must not go down.
    """
    reference, known = make_imitator(), []
    for number in range(lessons + 1):
        if number:
            teach(reference, number)
        known.append([stories(reference, number, frames) for frames in EPISODES])
    imitator, taken = make_imitator(), []

    def act() -> None:
        taken.append(acted(imitator, EPISODES[len(taken) % len(EPISODES)]))

    with beside(act) as errors:
        for number in range(1, lessons + 1):
            teach(imitator, number)
            wait_for(errors, max(2, steps // lessons // len(EPISODES[0])), taken)
    assert state_of(imitator) == state_of(reference)
    assert imitator.reports == reference.reports
    least = 0
    for number, answers in enumerate(taken):
        episode = number % len(EPISODES)
        told = [count for count in range(least, lessons + 1) if answers in known[count][episode]]
        assert told, (number, least)
        least = told[0]
    last = (len(taken) - 1) % len(EPISODES)
    assert taken[-1] == known[-1][last][0]


def test_an_imitator_acts_on_what_it_knew_before_a_demonstration_or_after_it():
    imitate_beside(lessons=12, steps=1500)


@pytest.mark.slow
def test_an_imitator_takes_a_hundred_thousand_steps_beside_two_hundred_demonstrations():
    imitate_beside(lessons=200, steps=100_000)


# Networks: the answer to an episode that is begun anew is of one number of lessons.


def watched(network: PACNet, understand: bool) -> Any:
    """What is recalled in an episode, sample by sample and at once, and what is recognised."""
    percepts = lesson(0)[0][::8]
    network.reset()
    one = plain(network.step(percepts[0]))
    network.reset()
    several = plain(network.recall(percepts))
    seen = None
    if understand:
        network.reset()
        seen = plain(network.recognise(percepts))
    return one, several, seen


@pytest.mark.parametrize("kind", KINDS)
def test_a_network_recalls_what_it_knew_before_a_lesson_or_after_it(kind: str):
    lessons, understand = 12, kind == "competing"
    network, reference = make_network(kind), make_network(kind)
    known = [watched(reference, understand)]
    for number in range(1, lessons):  # the map watches first, which is a lesson of its own
        percepts, targets = lesson(number)
        reference.attend(percepts)
        known.append(watched(reference, understand))
        reference.observe(percepts, targets, number, f"way {number % 3}")
        known.append(watched(reference, understand))
    taken: list[Any] = []
    with beside(lambda: taken.append(watched(network, understand))) as errors:
        for number in range(1, lessons):
            teach(network, number)
            wait_for(errors, 2, taken)
    assert state_of(network) == state_of(reference)
    for part in range(3 if understand else 2):
        assert_ascending([each[part] for each in taken], [each[part] for each in known])


def rows_of(engine: str, number: int) -> Tensor:
    return lesson(number)[0][: 10 if engine == "eager" else FRAMES]


@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_a_map_is_read_from_two_threads_while_a_third_observes(engine: str):
    sofm, reference = make_map(engine), make_map(engine)
    percepts, lessons = lesson(50)[0], 8
    reads = (lambda m: plain(m(percepts)), lambda m: plain(m.read_one(percepts[5])[0]))
    taken: tuple[list[Any], ...] = ([], [])
    works = [lambda: taken[0].append(reads[0](sofm)), lambda: taken[1].append(reads[1](sofm))]
    with beside(*works) as errors:
        for number in range(1, lessons + 1):
            sofm.observe(rows_of(engine, number))
            wait_for(errors, 3, *taken)
    known = [[read(reference) for read in reads]]
    for number in range(1, lessons + 1):
        reference.observe(rows_of(engine, number))
        known.append([read(reference) for read in reads])
    assert state_of(sofm) == state_of(reference)
    for part, answers in enumerate(taken):
        assert_ascending(answers, [each[part] for each in known])


@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_a_map_is_read_from_two_threads_while_a_third_steps(engine: str):
    sofm, reference, taken = make_map(engine), make_map(engine), [0, 0]
    percepts = lesson(50)[0]

    def read() -> None:
        attention = sofm(percepts)
        assert bool((attention.activation > 0).all())
        taken[0] += 1

    def look() -> None:
        assert sofm.read_one(percepts[5])[0].activation > 0
        taken[1] += 1

    with beside(read, look) as errors:
        for number in range(1, 9):
            for row in rows_of(engine, number):
                sofm.step(row)
            while min(taken) < 4 * number and not errors:
                time.sleep(1e-4)
    for number in range(1, 9):
        for row in rows_of(engine, number):
            reference.step(row)
    assert state_of(sofm) == state_of(reference)


# Several threads that learn: as if one did after the other.


@pytest.mark.parametrize("engine", ["eager", "compiled"])
@pytest.mark.parametrize("call", ["observe", "step"])
def test_two_threads_that_teach_a_map_are_as_one_after_the_other(engine: str, call: str):
    sofm, reference, done = make_map(engine), make_map(engine), [0, 0]
    rows, rounds = rows_of(engine, 1), 30
    trained = rows if call == "observe" else rows[3] + 0.5

    def study(who: int) -> None:
        if done[who] < rounds:
            getattr(sofm, call)(trained)
            done[who] += 1

    with beside(lambda: study(0), lambda: study(1)) as errors:
        while min(done) < rounds and not errors:
            time.sleep(1e-3)
    for _ in range(2 * rounds):  # the same each time, so that it does not matter who comes first
        getattr(reference, call)(trained)
    assert state_of(sofm) == state_of(reference)


@pytest.mark.parametrize("kind", KINDS)
def test_two_threads_that_teach_a_network_are_as_one_after_the_other(kind: str):
    network = make_network(kind)
    before, rounds, done = int(network.sofm.time), 6, [0, 0]
    percepts, targets = lesson(1)

    def study(who: int) -> None:
        if done[who] < rounds:
            network.observe(percepts, targets, 1, "way 1")
            done[who] += 1

    with beside(lambda: study(0), lambda: study(1)) as errors:
        while min(done) < rounds and not errors:
            time.sleep(1e-3)
    reference = make_network(kind)
    for _ in range(2 * rounds):  # the same lesson each time, in any order
        reference.observe(percepts, targets, 1, "way 1")
    assert int(network.sofm.time) == before + 2 * rounds * FRAMES
    assert state_of(network) == state_of(reference)


@pytest.mark.parametrize("kind", KINDS)
def test_of_two_threads_none_teaches_an_episode_before_the_last_one(kind: str):
    network, done = make_network(kind), [0, 0]
    percepts, targets = lesson(1, rows=5)

    def study(who: int) -> None:
        if done[who] < 40:
            done[who] += 1
            with contextlib.suppress(ValueError):  # where the other one was faster
                network.observe(percepts, targets, 2 * done[who] + who)

    with beside(lambda: study(0), lambda: study(1)) as errors:
        while min(done) < 40 and not errors:
            time.sleep(1e-3)
    assert int(network.episode) >= 80
    network.check_state(network.state_dict())  # no number after a larger one


def test_two_threads_that_teach_an_imitator_are_as_one_after_the_other():
    imitator, done = make_imitator(), [0, 0]

    def study(who: int) -> None:
        if done[who] < 5:
            done[who] += 1
            [lesson] = imitator.learn(demonstrations(2 * done[who] + who))
            assert lesson.episode == 2 * done[who] + who

    with beside(lambda: study(0), lambda: study(1)) as errors:
        while min(done) < 5 and not errors:
            time.sleep(1e-3)
    reference = make_imitator()
    for report in imitator.reports[1:]:  # in the order in which they came
        teach(reference, report.episode)
    assert len(imitator.reports) == 11
    assert imitator.reports == reference.reports
    assert state_of(imitator) == state_of(reference)


def test_a_map_that_is_taught_beside_its_network_ends_nothing():
    network = make_network("cue")
    with beside(lambda: network.sofm.step(lesson(3)[0][7])):
        for number in range(1, 6):
            try:
                teach(network, number)
            except ValueError:  # the map may have nodes without motor schemas
                break


# Saving.


@pytest.mark.parametrize("kind", [*KINDS, "imitator"])
def test_what_is_saved_beside_learning_is_of_before_a_lesson_or_after_it(kind: str, tmp_path: Path):
    make: Callable[[], Any] = (
        make_imitator if kind == "imitator" else functools.partial(make_network, kind)
    )
    model, reference = make(), make()
    states, taken, loaded = [state_of(reference)], [], []
    for number in range(1, 6):
        if isinstance(reference, PACNet):
            reference.attend(lesson(number)[0])
            states.append(state_of(reference))
            percepts, targets = lesson(number)
            reference.observe(percepts, targets, number, f"way {number % 3}")
        else:
            teach(reference, number)
        states.append(state_of(reference))

    def save() -> None:
        model.save_pretrained(tmp_path)
        loaded.append(state_of(type(model).from_pretrained(tmp_path)))

    with beside(lambda: taken.append(state_of(model)), save) as errors:
        for number in range(1, 6):
            teach(model, number)
            wait_for(errors, 2, taken, loaded)
    assert state_of(model) == states[-1]
    for answers in (taken, loaded):
        assert_ascending(answers, states)


def test_the_mode_that_is_set_while_it_learns_stays(monkeypatch: pytest.MonkeyPatch):
    network = make_network("cue")
    write = type(network.schemas).add_samples

    def leave_training(*given: Any) -> None:
        write(*given)
        network.eval()

    monkeypatch.setattr(type(network.schemas), "add_samples", leave_training)
    teach(network, 1)
    assert not any(module.training for module in network.modules())
