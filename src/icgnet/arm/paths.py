"""Ways through joint space that meet nothing: RRT-Connect, then shortcuts."""

from functools import cache

import numpy as np
from jaxtyping import Float

from icgnet.arm.scene import CollisionChecker

LONGEST_STEP = 0.6
"""A tree grows by steps of at most this [rad], summed up in squares over the joints."""
MOST_TRIES = 600
"""So many positions the trees grow towards; a way that needs more is given up."""
SHORTCUTS = 40
"""Tries to shorten a way."""
COARSE = 0.02
"""How far any point may move between two positions that are tested while a way is looked for [m]. The trajectory that
comes of it is tested more finely."""


class PathFinder:
    """Looks for ways of one arm with one load.

    Args:
        checker: says what meets.
        margin: distance that is kept from everything around [m].
        rng: draws the positions that trees grow towards.
    """

    def __init__(self, checker: CollisionChecker, margin: float, rng: np.random.Generator) -> None:
        self._checker, self._margin, self._rng = checker, margin, rng
        self._lower, self._upper = checker.arm.lower, checker.arm.upper

    def find(
        self, start: Float[np.ndarray, "j"], goal: Float[np.ndarray, "j"], most_tries: int = MOST_TRIES
    ) -> Float[np.ndarray, "n j"] | None:
        """Waypoints from start to goal, joined by straight lines in joint space; None if no way was found."""
        if self.is_free(start, goal):
            return np.array([start, goal])
        way = self._connect(start, goal, most_tries)
        return None if way is None else self._shortened(way)

    def is_free(self, start: Float[np.ndarray, "j"], goal: Float[np.ndarray, "j"]) -> bool:
        """Whether nothing meets on the straight line between two positions."""
        count = int(np.ceil(np.abs(goal - start) @ self._checker.reaches / COARSE)) + 1
        path = start + _spread(max(2, count))[:, None] * (goal - start)
        return self._checker.first_collision(path, self._margin) is None

    def _connect(
        self, start: Float[np.ndarray, "j"], goal: Float[np.ndarray, "j"], most_tries: int
    ) -> list[Float[np.ndarray, "j"]] | None:
        """RRT-Connect: two trees that grow in turn, each towards a drawn position and then towards the other.

        Paper: none; Kuffner and LaValle (2000).
        """
        trees = (_Tree(start), _Tree(goal))
        growing, other = trees
        for _ in range(most_tries):
            drawn = self._rng.uniform(self._lower, self._upper)
            reached = self._grow(growing, drawn)
            if reached is not None:
                target = growing.positions[reached]
                last = None
                while (met := self._grow(other, target)) is not None:
                    last = met
                    if np.array_equal(other.positions[met], target):
                        break
                if last is not None and np.array_equal(other.positions[last], target):
                    mine, theirs = growing.branch(reached), other.branch(last)
                    forward = [*mine[::-1], *theirs[1:]]
                    return forward if growing is trees[0] else forward[::-1]
            growing, other = other, growing
        return None

    def _grow(self, tree: "_Tree", target: Float[np.ndarray, "j"]) -> int | None:
        """Number of a new node, one step nearer to the target; None if something is in the way or it is there."""
        nearest = tree.nearest(target)
        start = tree.positions[nearest]
        distance = float(np.linalg.norm(target - start))
        if distance == 0.0:
            return None
        end = target if distance <= LONGEST_STEP else start + LONGEST_STEP / distance * (target - start)
        return tree.add(end, nearest) if self.is_free(start, end) else None

    def _shortened(self, way: list[Float[np.ndarray, "j"]]) -> Float[np.ndarray, "n j"]:
        """The way without detours: straight lines between drawn points on it take the place of what is between."""
        for _ in range(SHORTCUTS):
            if len(way) == 2:
                break
            first, last = sorted(self._rng.uniform(0.0, len(way) - 1.0, 2))
            before, after = int(first), int(last)
            if before == after:
                continue
            start = way[before] + (first - before) * (way[before + 1] - way[before])
            end = way[after] + (last - after) * (way[min(after + 1, len(way) - 1)] - way[after])
            between = sum(
                float(np.linalg.norm(b - a))
                for a, b in zip([start, *way[before + 1 : after + 1]], [*way[before + 1 : after + 1], end], strict=True)
            )
            if np.linalg.norm(end - start) < 0.99 * between and self.is_free(start, end):
                way = [*way[: before + 1], start, end, *way[after + 1 :]]
        return np.array(self._straightened(way))

    def _straightened(self, way: list[Float[np.ndarray, "j"]]) -> list[Float[np.ndarray, "j"]]:
        """The way without the waypoints that can be left out."""
        index = 1
        while index < len(way) - 1:
            if self.is_free(way[index - 1], way[index + 1]):
                del way[index]
            else:
                index += 1
        return way


class _Tree:
    """Positions that can be reached from a root."""

    def __init__(self, root: Float[np.ndarray, "j"]) -> None:
        self.positions = np.empty((64, len(root)))
        self.positions[0] = root
        self._parents = [-1]

    def __len__(self) -> int:
        return len(self._parents)

    def nearest(self, target: Float[np.ndarray, "j"]) -> int:
        """Number of the node nearest to a position."""
        return int(((self.positions[: len(self)] - target) ** 2).sum(axis=1).argmin())

    def add(self, position: Float[np.ndarray, "j"], parent: int) -> int:
        """Number of a new node."""
        if len(self) == len(self.positions):
            self.positions = np.concatenate([self.positions, np.empty_like(self.positions)])
        self.positions[len(self)] = position
        self._parents.append(parent)
        return len(self) - 1

    def branch(self, node: int) -> list[Float[np.ndarray, "j"]]:
        """The positions from a node to the root."""
        found = []
        while node >= 0:
            found.append(self.positions[node].copy())
            node = self._parents[node]
        return found


@cache
def _spread(count: int) -> Float[np.ndarray, "n"]:
    """So many numbers evenly from 0 to 1, first 0 and then always far from those before, so that hits come early."""
    shares = np.linspace(0.0, 1.0, count)
    reversed_digits = [int(f"{index:032b}"[::-1], 2) for index in range(count)]
    return shares[np.argsort(reversed_digits, kind="stable")]
