"""The order in which nodes or schemas win an episode, and how often the winner changes."""

from __future__ import annotations

from itertools import groupby

from numpy.typing import ArrayLike

from pacnet.evaluation.arrays import integer_series


def winner_order(winners: ArrayLike, min_run: int = 3) -> tuple[int, ...]:
    """Return the order in which nodes won, without flicker and without repeats.

    First the samples without a winner (negative) are left out. Then every run of one winner that is
    shorter than `min_run` is dropped. Last, neighbouring runs of one winner are merged:

        A A A A B A A A A    -> (A,)
        A A A A B A B B B B  -> (A, B): the inner B and A are runs of one sample each

    Args:
        winners: Index of the winner at each sample, negative for none `[T]`.
        min_run: Fewest samples in a row that count as winning.

    Raises:
        ValueError: Winners that are not a sequence of integers, or a `min_run` below 1.
    """
    if min_run < 1:
        raise ValueError(f"expected min_run ≥ 1 sample, got {min_run}")
    runs = [(node, len(list(run))) for node, run in groupby(_without_gaps(winners))]
    lasting = [node for node, length in runs if length >= min_run]
    return tuple(node for node, _ in groupby(lasting))


def order_agreement(order_a: ArrayLike, order_b: ArrayLike) -> float:
    """Return the agreement of two orders of winners, from 0 to 1.

    The length of their longest common subsequence over the length of the longer one.

    Args:
        order_a: Nodes in the order in which they won, from `winner_order`.
        order_b: The same of another episode.

    Returns:
        The agreement; 1 for two empty orders.

    Raises:
        ValueError: Orders that are not sequences of integers.
    """
    a = integer_series("an order", order_a).tolist()
    b = integer_series("an order", order_b).tolist()
    if not (a or b):
        return 1.0
    longest = [0] * (len(b) + 1)  # of the part of a read so far and each beginning of b
    for node in a:
        previous = longest
        longest = [0]
        for index, other in enumerate(b):
            extended = previous[index] + 1 if node == other else 0
            longest.append(max(extended, previous[index + 1], longest[index]))
    return longest[-1] / max(len(a), len(b))


def switches(winners: ArrayLike) -> int:
    """Return the number of changes from one winner to the next, flicker included.

    Samples without a winner (negative) are left out: A, none, A is no change; A, none, B is one.

    Args:
        winners: Index of the winner at each sample, negative for none `[T]`.

    Raises:
        ValueError: Winners that are not a sequence of integers.
    """
    return max(sum(1 for _ in groupby(_without_gaps(winners))) - 1, 0)


def _without_gaps(winners: ArrayLike) -> list[int]:
    """Return the winners of the samples that have one."""
    return [node for node in integer_series("winners", winners).tolist() if node >= 0]
