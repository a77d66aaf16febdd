"""The hand's implied closing: it takes hold of a glass within reach and lets go on the table.

The bodies have no finger joints. Taking hold switches a weld on at the current relative pose, so
that nothing jumps; letting go switches it off.
"""

TAKE_DISTANCE = 0.03  # [m] of the grip from the stretch of the glass's axis that fits a hand
TAKE_SPEED = 0.05  # [m/s] of the grip relative to the glass; taken faster, the glass is dragged
BREAK_DISTANCE = 0.03  # [m] the glass may be pulled out of the hand
LIFTED_HEIGHT = 0.02  # [m] above the table: from there on, coming back means putting down
PUT_HEIGHT = 0.012  # [m] above the table at which the hand lets go
PUT_SPEED = 0.05  # [m/s] of the glass when the hand lets go
LEFT_DISTANCE = 0.08  # [m] the hand must have gone away before it takes hold again


class Grip:
    """One hand's hold on one glass; `update` decides once per control step."""

    def __init__(self) -> None:
        """Starts with an empty hand."""
        self.held = False
        self._lifted = False
        self._ready = True

    def release(self) -> None:
        """Lets go; the hand takes hold again only after it has gone away."""
        self.held = self._lifted = self._ready = False

    def update(self, distance: float, slip: float, speed: float, height: float) -> None:
        """Takes hold or lets go.

        Args:
            distance: of the grip from where a hand can take the glass [m].
            slip: of the glass from where the hand took it [m]; read while held.
            speed: of the grip relative to the glass, or of the held glass [m/s].
            height: of the glass's bottom above the table [m].
        """
        if self.held:
            self._lifted = self._lifted or height >= LIFTED_HEIGHT
            is_put = self._lifted and height <= PUT_HEIGHT and speed <= PUT_SPEED
            if is_put or slip > BREAK_DISTANCE:
                self.release()
            return
        self._ready = self._ready or distance > LEFT_DISTANCE
        self.held = self._ready and distance <= TAKE_DISTANCE and speed <= TAKE_SPEED
