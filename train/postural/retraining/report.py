"""The results of the retraining experiment: means over replicates, a figure, a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from envs.mishaps import MISHAPS
from pacnet.evaluation.figure_style import BLUE, GREY, INK, VERMILION, new_figure, tidy
from train.common.summary import Summary, mean_and_std, summarise
from train.postural.retraining.replicates import POLICIES, Replicate, shown_to
from train.postural.scores import Scores

WANTED = 0.9  # goal of the task success rate
LABELS = {
    "overwriting": "overwriting, as drawn",
    "several_schemas": "several schemas, as drawn",
    "overwriting_spoiled_last": "overwriting, spoiled last",
    "several_schemas_spoiled_last": "several schemas, spoiled last",
    "unspoiled": "overwriting, unspoiled alone",
}
BASELINES = {  # policy -> the one that overwrites and learns the same demonstrations
    "several_schemas": "overwriting",
    "several_schemas_spoiled_last": "overwriting_spoiled_last",
}
SHOWN = (
    "task_success_rate", "wrist_distance_mean_m", "wrist_distance_max_m", "nodes", "schemas",
)  # fmt: skip

_KEY = (
    Line2D([], [], color=BLUE, marker="o", markersize=4.5, linestyle="none", label="a replicate"),
    Line2D(
        [], [], color=VERMILION, marker="o", markersize=4.5, linestyle="none",
        label="a replicate, spoiled one last",
    ),
    Line2D(
        [], [], color=INK, marker="|", markersize=12, markeredgewidth=2, linestyle="none",
        label="mean",
    ),
    Line2D([], [], color=GREY, linewidth=5, alpha=0.4, label="goal of several schemas"),
)  # fmt: skip


class Outcome(NamedTuple):
    """The scores of one replicate."""

    replicate: Replicate
    scores: Mapping[str, Scores]  # policy -> its scores


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return all that `metrics.json` holds: every policy over the replicates, and each replicate.

    Args:
        outcomes: Of one or more replicates.
    """
    policies = summarise_policies(outcomes)
    return {
        "policies": policies,
        "gained_over_overwriting": {
            policy: summarise([_gain(one.scores[policy], one.scores[other]) for one in outcomes])
            for policy, other in BASELINES.items()
        },
        "groups": {
            name: {"replicates": len(group), "policies": summarise_policies(group)}
            for name, group in groups(outcomes).items()
        },
        "replicates": [
            {"seed": one.replicate.seed, "mishaps": one.replicate.mishaps, "policies": one.scores}
            for one in outcomes
        ],
    }


def summarise_policies(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Summary]]:
    """Return policy -> score -> mean, standard deviation and values over the replicates."""
    return {
        policy: summarise([outcome.scores[policy] for outcome in outcomes])
        for policy in outcomes[0].scores
    }


def groups(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Return the replicates by what was spoiled, without empty groups; groups may overlap."""
    named = {
        f"with {mishap}": [one for one in outcomes if mishap in one.replicate.mishaps]
        for mishap in MISHAPS
    }
    named["drawn last spoiled"] = [one for one in outcomes if one.replicate.mishaps[-1] is not None]
    named["drawn last unspoiled"] = [one for one in outcomes if one.replicate.mishaps[-1] is None]
    return {name: group for name, group in named.items() if group}


def _gain(ours: Scores, overwriting: Scores) -> Scores:
    """Return the gain in each score over a network that learned the same demonstrations."""
    return {name: ours[name] - overwriting[name] for name in SHOWN[:3]}


def draw(outcomes: Sequence[Outcome]) -> Figure:
    """Draw the success rate of each policy: a dot for each replicate, and the mean."""
    policies = summarise_policies(outcomes)
    figure = new_figure(8, 1.9 + 0.6 * len(policies))
    axes = figure.subplots()
    tidy(axes, "Task success after spoiled demonstrations", "success rate", "")
    for row, (policy, scores) in enumerate(policies.items()):
        success = scores["task_success_rate"]
        rates = np.array(success["values"])
        heights = row + _apart(rates)
        spoiled = np.array([ends_spoiled(policy, one.replicate) for one in outcomes])
        for chosen, colour in ((~spoiled, BLUE), (spoiled, VERMILION)):
            axes.plot(rates[chosen], heights[chosen], "o", color=colour, markersize=4.5)
        axes.plot(success["mean"], row, "|", color=INK, markersize=24, markeredgewidth=2)
        axes.text(1.04, row, f"{success['mean']:.0%}", va="center", color=INK)
    axes.axvline(WANTED, color=GREY, linewidth=5, alpha=0.4, zorder=0)
    axes.set_xlim(-0.03, 1.12)
    axes.set_xticks(np.linspace(0, 1, 6))
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    axes.set_yticks(range(len(policies)), [LABELS[policy] for policy in policies])
    axes.invert_yaxis()  # the first policy on top
    axes.grid(visible=False, axis="y")
    figure.legend(handles=_KEY, loc="outside lower center", ncols=2, frameon=False)
    return figure


def ends_spoiled(policy: str, replicate: Replicate) -> bool:
    """Return whether the last demonstration that a network learned is spoiled."""
    return replicate.mishaps[shown_to(POLICIES[policy], replicate)[-1]] is not None


def print_tables(scores: Mapping[str, Any]) -> None:
    """Print every policy over all replicates, its gain, and success by what was spoiled."""
    count = len(scores["replicates"])
    print("\n" + f"{f'{count} replicate(s), mean ± std':36}" + "".join(f"{n:>24}" for n in SHOWN))
    for policy, values in scores["policies"].items():
        print(f"{LABELS[policy]:36}" + "".join(_mean_and_std(values[name]) for name in SHOWN))
    print("\ngained over overwriting")
    for policy, values in scores["gained_over_overwriting"].items():
        print(f"{LABELS[policy]:36}" + "".join(_mean_and_std(values[n]) for n in SHOWN[:3]))
    groups = scores["groups"]
    print("\n" + f"{'task_success_rate':36}" + "".join(f"{name:>24}" for name in groups))
    print(f"{'replicates':36}" + "".join(f"{group['replicates']:24}" for group in groups.values()))
    for policy in scores["policies"]:
        rates = [group["policies"][policy]["task_success_rate"] for group in groups.values()]
        print(f"{LABELS[policy]:36}" + "".join(map(_mean_and_std, rates)))


def _mean_and_std(score: Summary) -> str:
    return f"{mean_and_std(score, 4):>24}"


def _apart(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return offsets `[R]` about 0 that separate dots of the same value."""
    same = values[:, None] == values
    place = np.tril(same, -1).sum(axis=1)  # how many of the same value come before
    return 0.07 * (place - (same.sum(axis=1) - 1) / 2)
