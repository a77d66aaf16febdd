"""The tables of Metaworld seen by a camera, in docs/benchmarks.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from statistics import fmean, median

from benchmarks import results_page
from benchmarks.harness import NOTHING, Table, number
from benchmarks.metaworld.camera import disturbances
from benchmarks.metaworld.camera.evaluation import ABSENT, NEAR, SIGHTS
from benchmarks.metaworld.camera.learners import LEARNERS, OURS, TITLES
from benchmarks.metaworld.camera.world import SIDE
from benchmarks.metaworld.evaluation import EPISODES, SEEDS
from benchmarks.metaworld.recording import NOISE
from benchmarks.metaworld.recording import SEEDS as SHOWN_SEEDS
from benchmarks.metaworld.results import Cell, Result
from benchmarks.metaworld.simulation import FPS, HORIZON

Found = Mapping[Cell, Result]
COMMAND = "python -m benchmarks.metaworld --camera"
TEXT = f"""`{COMMAND}` runs it: what is perceived are the hand's place, the
gripper, and a picture of {SIDE} × {SIDE} pixels by the camera that LeRobot's environment of
Metaworld has, at {FPS} Hz; the places of objects and goals are not. Metaworld's scripted experts
demonstrate with noise of {NOISE:g} on each action, draw d from seed {SHOWN_SEEDS:,} (d + 1) on;
then things lie elsewhere, in episode e as seed {SEEDS:,} + {EPISODES:,} d + e decides. Success:
share of the episodes in which Metaworld says so within {HORIZON} steps, over {{ours}} for
{" and ".join(TITLES[name] for name in OURS)}, over {{others}} for the others. `patches` and `pca`
are the imitator with that kind of encoder; it chooses by itself otherwise; `pretrained` has the
lower part of EfficientNet-lite0, trained on ImageNet by others. Of the baselines, replay
repeats the demonstration whose first picture is nearest; shifted replay follows the hand's path of
a demonstration, shifted to where the first picture's principal components tell it to go; 1-NN, BC
and ACT (LeRobot's, small, nothing pretrained, trained for 150 s on two cores with
pictures of half the side) see every picture.
"""
SIGHTS_TEXT = f"""Success of `Imitator` where pictures differ from those shown while it acts, at the
same seeds: light, noise on each number of a picture of 0 to 255, a disc of a random colour away
from hand, object and goal, a camera that looks elsewhere. `{COMMAND} --learners pacnet`, {{ours}}.
"""
NOVELTY_TEXT = f"""Object absent: share of the episodes in which `Imitator` calls what it perceives
new before the hand is within {100 * NEAR:.0f} cm of where the object would be, which is invisible.
False alarms: share of the ordinary episodes, with the object, in which it calls anything new before
it succeeds. The same command and seeds, {{ours}}.
"""
TIMES_TEXT = """Median over all cells: of the time to learn all demonstrations, whose pictures are
decoded already, and of the median time of a step, with its picture. One thread; ACT: two.
"""


def markdown(found: Found) -> str:
    """Return all tables."""
    tables = (success_table(found), sights_table(found), novelty_table(found), times_table(found))
    return "\n\n".join(str(table) for table in tables if table.rows)


def write(found: Found) -> None:
    """Write the tables into docs/."""
    results_page.update("metaworld-camera", markdown(found))


def success_table(found: Found) -> Table:
    """Return a row for each task and number of demonstrations, as shown."""
    usual = {cell: result for cell, result in found.items() if not cell.sight}
    measured = {cell.learner for cell in usual}
    learners = [name for name in LEARNERS if name in measured]
    rows = [
        (f"{task}, {count}", *(_share(_of(usual, task, count, name)) for name in learners))
        for task, count in places(usual)
    ]
    columns = ("task, demonstrations", *(TITLES[name] for name in learners))
    text = TEXT.format(
        ours=_extent(usual, OURS), others=_extent(usual, [n for n in learners if n not in OURS])
    )
    return Table("Metaworld, seen by a camera", text, columns, rows)


def sights_table(found: Found) -> Table:
    """Return a row for each task and number of demonstrations, a column for each disturbance."""
    own = {cell: result for cell, result in found.items() if cell.learner == OURS[0]}
    sights = [name for name in SIGHTS if name != ABSENT and any(c.sight == name for c in own)]
    rows = []
    for task, count in places(own):
        parts = [_of(own, task, count, sight=sight) for sight in sights]
        rows.append((f"{task}, {count}", *map(_share, parts)))
    columns = ("task, demonstrations", *(disturbances.TITLES[name] for name in sights))
    rows = rows if len(sights) > 1 else []
    text = SIGHTS_TEXT.format(ours=_extent(own, OURS))
    return Table("Metaworld: pictures that differ from those shown", text, columns, rows)


def novelty_table(found: Found) -> Table:
    """Return a row for each task and number of demonstrations: what was called new, and when."""
    own = {cell: result for cell, result in found.items() if cell.learner == OURS[0]}
    rows = []
    for task, count in places({cell: r for cell, r in own.items() if cell.sight == ABSENT}):
        absent = _of(own, task, count, sight=ABSENT)
        usual = _of(own, task, count)
        rows.append((f"{task}, {count}", _percent(called(absent)), _percent(alarms(usual))))
    columns = ("task, demonstrations", "object absent", "false alarms")
    text = NOVELTY_TEXT.format(ours=_extent(own, OURS))
    return Table("Metaworld: what is called new", text, columns, rows)


def times_table(found: Found) -> Table:
    """Return a row for each learner and number of demonstrations."""
    rows = []
    for name in LEARNERS:
        usual = {c: r for c, r in found.items() if c.learner == name and not c.sight}
        for count in sorted({cell.demonstrations for cell in usual}):
            part = [result for cell, result in usual.items() if cell.demonstrations == count]
            learning = number(median(result.learning_s for result in part))
            step = number(median(result.step_us for result in part) / 1e3)
            rows.append((f"{TITLES[name]}, {count}", learning, step))
    columns = ("learner, demonstrations", "learning [s]", "step [ms]")
    return Table("Metaworld, seen by a camera: times", TIMES_TEXT, columns, rows)


def places(found: Iterable[Cell]) -> list[tuple[str, int]]:
    """Return the tasks, in the order in which they came, with their numbers of demonstrations."""
    tasks = list(dict.fromkeys(cell.task for cell in found))
    counts = sorted({cell.demonstrations for cell in found})
    return [(task, count) for task in tasks for count in counts]


def called(results: Iterable[Result]) -> list[bool]:
    """Return whether each episode was called new before the hand came to the object's place."""
    pairs = [
        pair
        for one in results
        for pair in zip(one.first_held or (), one.reached or (), strict=True)
    ]
    return [held > 0 and (not reached or held <= reached) for held, reached in pairs]


def alarms(results: Iterable[Result]) -> list[bool]:
    """Return whether anything was called new in each episode."""
    return [held > 0 for one in results for held in one.first_held or ()]


def _of(
    found: Found, task: str, count: int, learner: str = OURS[0], sight: str = ""
) -> list[Result]:
    """Return the results of all draws."""
    key = (task, count, learner, sight)
    return [r for c, r in found.items() if (c.task, c.demonstrations, c.learner, c.sight) == key]


def _share(results: list[Result]) -> str:
    """Return the success of all episodes as a cell."""
    return _percent([success for one in results for success in one.successes])


def _percent(flags: list[bool]) -> str:
    return f"{fmean(flags):.0%}" if flags else NOTHING


def _extent(found: Found, learners: Iterable[str]) -> str:
    """Return how many draws and episodes some learners were measured in."""
    part = {cell: result for cell, result in found.items() if cell.learner in learners}
    draws = sorted({cell.draw for cell in part})
    episodes = sorted({len(result.successes) for result in part.values()})
    if not part:
        return "no draw"
    plural = "s" if len(draws) > 1 else ""
    numbers = ", ".join(map(str, draws))
    return f"{' or '.join(map(str, episodes))} episodes of draw{plural} {numbers}"
