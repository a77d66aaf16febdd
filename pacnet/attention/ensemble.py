"""Many growing maps that learn from as many streams in one call: seeds, thresholds, robots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor, nn

from pacnet.attention.records import Attention, Observation
from pacnet.attention.sofm import HabituatingSOFM
from pacnet.kernels.threads import in_threads


class SOFMEnsemble(nn.Module):
    """B independent maps, each with its own config, side by side in as many threads as torch uses.

    Each map learns what it would learn alone, bit for bit. On the CPU the compiled kernels let
    Python go on, so that the threads share the cores. On another device the eager engine runs, a
    map after the other within each thread; that has not been tried on a GPU.

    Args:
        maps: the maps; they stay those of the caller.

    Raises:
        ValueError: no map, one of them twice, or something else.

    Example:
        >>> maps = [HabituatingSOFM(SOFMConfig.paper(2, novelty_threshold=t)) for t in (0.2, 0.8)]
        >>> records = SOFMEnsemble(maps).observe(torch.rand(2, 500, 2))
        >>> len(maps[0]) < len(maps[1])
        True
    """

    def __init__(self, maps: Iterable[HabituatingSOFM]) -> None:
        super().__init__()
        members = list(maps)
        for member in members:
            if not isinstance(member, HabituatingSOFM):
                raise ValueError(f"expected HabituatingSOFMs, got {type(member).__name__}")
        if not members or len({id(sofm) for sofm in members}) < len(members):
            raise ValueError(f"expected one or more different maps, got {len(members)}")
        self.maps = nn.ModuleList(members)

    def __len__(self) -> int:
        """The number of maps."""
        return len(self.maps)

    def forward(self, percepts: Tensor | Sequence[Tensor]) -> list[Attention]:
        """Reads every map; see `HabituatingSOFM.forward`.

        Args:
            percepts: a stream for each map, `[B, T, D]`, or a sequence of B tensors `[T, D]`.

        Raises:
            ValueError: not a stream for each map, or one that its map refuses.
        """
        streams = self._streams(percepts)
        return [sofm.read(stream) for sofm, stream in zip(self._members, streams, strict=True)]

    @torch.no_grad()
    def observe(self, percepts: Tensor | Sequence[Tensor]) -> list[Observation]:
        """Every map learns its stream; see `HabituatingSOFM.observe`.

        Args:
            percepts: a stream for each map, `[B, T, D]`, or a sequence of B tensors `[T, D]`, whose
                lengths may differ.

        Raises:
            ValueError: not a stream for each map, or one that its map refuses; nothing has been
                learned then.
        """
        pairs = list(zip(self._members, self._streams(percepts), strict=True))
        return in_threads(_learn, pairs)

    @property
    def _members(self) -> list[HabituatingSOFM]:
        return [sofm for sofm in self.maps if isinstance(sofm, HabituatingSOFM)]

    def _streams(self, percepts: Tensor | Sequence[Tensor]) -> list[Tensor]:
        """The streams, checked and scaled, before any map has learned."""
        if not isinstance(percepts, Sequence) and not (
            isinstance(percepts, Tensor) and percepts.dim() > 0
        ):
            raise ValueError(f"expected a stream for each map, got {percepts!r}")
        streams = list(percepts)
        if len(streams) != len(self):
            raise ValueError(f"expected a stream for each of {len(self)} maps, got {len(streams)}")
        return [sofm.scaled(stream) for sofm, stream in zip(self._members, streams, strict=True)]


def _learn(pair: tuple[HabituatingSOFM, Tensor]) -> Observation:
    sofm, stream = pair
    with torch.no_grad():  # which holds for a thread
        return sofm.observe_scaled(stream)
