"""Waiting until objects rest, and taking away what has left the workspace, as the published benchmark does."""

import numpy as np

from icgnet.simulation.motion import steps_in
from icgnet.simulation.surroundings import ENDLESS, Surroundings
from icgnet.simulation.world import World

REST_SPEED = 0.01  # [m/s and rad/s together]
REST_CHECK = 0.25  # time between two looks at the speeds [s]
REST_TIMEOUT = 2.0  # [s]


class Settling:
    """Lets the objects of a world come to rest, and counts what leaves.

    Attributes:
        lost: objects that have left the workspace so far.
        top_speed: largest speed of any object so far [m/s]; nan if it is not watched.
    """

    def __init__(self, world: World, surroundings: Surroundings = ENDLESS, watch_speed: bool = False) -> None:
        """Begins with nothing lost.

        Args:
            world: the world.
            surroundings: say where objects may be; the cube where the table has no end.
            watch_speed: look at the speeds after every step, which is slower.
        """
        self._world = world
        self._lower, self._upper = surroundings.bounds
        self.lost = 0
        self.top_speed = 0.0 if watch_speed else float("nan")

    def wait_for_rest(self, timeout: float) -> None:
        """Goes on until all objects rest, for at most `timeout` [s]."""
        steps = steps_in(REST_CHECK, self._world.physics)
        for _ in range(round(timeout / REST_CHECK)):
            self._step(steps)
            if self._world.speeds().max(initial=0.0) <= REST_SPEED:
                return

    def remove_outside(self) -> None:
        """Waits for rest and takes away what has left the workspace, until nothing more leaves it.

        An object has left when its centre of mass is beside the cube (the table, the bin) or below the floor of the
        cube; there is no upper limit.
        """
        while True:
            self.wait_for_rest(REST_TIMEOUT)
            centres = self._world.centres_of_mass()
            beside = ((centres[:, :2] < self._lower) | (centres[:, :2] > self._upper)).any(axis=1)
            outside = (beside | (centres[:, 2] < 0.0)) & self._world.present
            for index in np.flatnonzero(outside):
                self._world.park(int(index))
            self.lost += int(outside.sum())
            if not outside.any():
                return

    def _step(self, count: int) -> None:
        if np.isnan(self.top_speed):
            self._world.step(count)
            return
        for _ in range(count):
            self._world.step()
            self.top_speed = max(self.top_speed, float(self._world.linear_speeds().max(initial=0.0)))
