"""Numbers of episodes in words, as ranges."""

from collections.abc import Iterable


def episodes_text(episodes: Iterable[int]) -> str:
    """Return the numbers of episodes with their noun."""
    numbers = numbers_text(episodes)
    return f"episode {numbers}" if numbers.isdigit() else f"episodes {numbers}"


def numbers_text(numbers: Iterable[int]) -> str:
    """Return numbers as ranges, as --episodes takes them: 0,2,5-9."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)
