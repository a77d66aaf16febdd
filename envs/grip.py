"""The closing of a hand: it takes hold of a glass within reach and lets go on the table.

The bodies have no finger joints. Taking hold activates a weld at the current relative pose, so
nothing jumps; letting go deactivates it.
"""

TAKE_DISTANCE = 0.03  # [m] from the grip to the part of the glass's axis that fits a hand
TAKE_SPEED = 0.05  # [m/s] of the grip relative to the glass; a faster one would drag it
BREAK_DISTANCE = 0.03  # [m] slip at which the glass is pulled out of the hand
LIFTED_HEIGHT = 0.02  # [m] above the table, from which a glass counts as lifted
PUT_HEIGHT = 0.012  # [m] above the table, below which the hand lets go
PUT_SPEED = 0.05  # [m/s] largest speed of the glass at which the hand lets go
LEFT_DISTANCE = 0.08  # [m] from the glass, before the hand can take hold again


class Grip:
    """One hand's hold on one glass; `update` decides once per control step."""

    def __init__(self) -> None:
        """Start with an empty hand."""
        self.held = False
        self._lifted = False
        self._ready = True

    def release(self) -> None:
        """Let go; the hand can take hold again only after moving away."""
        self.held = self._lifted = self._ready = False

    def update(self, distance: float, slip: float, speed: float, height: float) -> None:
        """Take hold or let go.

        Args:
            distance: Of the grip from where a hand can take the glass [m].
            slip: Of the glass from where the hand took it [m]; read while held.
            speed: Of the grip relative to the glass, or of the held glass [m/s].
            height: Of the glass's bottom above the table [m].
        """
        if self.held:
            self._lifted = self._lifted or height >= LIFTED_HEIGHT
            is_put = self._lifted and height <= PUT_HEIGHT and speed <= PUT_SPEED
            if is_put or slip > BREAK_DISTANCE:
                self.release()
            return
        self._ready = self._ready or distance > LEFT_DISTANCE
        self.held = self._ready and distance <= TAKE_DISTANCE and speed <= TAKE_SPEED
