"""A field on a lattice: exact where its surface is, interpolated elsewhere."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage


class Lattice:
    """Values of a field at the nodes of a lattice in a box, which are asked for step by step.

    All nodes of the first, coarse lattice are wanted, and of each finer one those of the cells that the surface (where
    the field is 0) passes through or that were seen, until the surface leaves them nowhere, as in multiresolution
    isosurface extraction (Mescheder et al. 2019). The others keep what lies between the coarser ones. Whoever knows the
    field fills in what is missing, if wanted for several lattices at once:

        while len(nodes := lattice.missing()):
            lattice.fill(nodes, field(lattice.positions(nodes)))

    Args:
        lower: position of the first node [m].
        pitch: distance of the nodes [m].
        values: at the nodes so far.
        is_known: at which of them the value is the field's own.
        is_wanted: at which of them it shall be.
    """

    def __init__(
        self,
        lower: Float[np.ndarray, "3"],
        pitch: float,
        values: Float[np.ndarray, "x y z"],
        is_known: Bool[np.ndarray, "x y z"],
        is_wanted: Bool[np.ndarray, "x y z"],
    ) -> None:
        self.lower, self.pitch, self.values = lower, pitch, values
        self._is_known, self._is_wanted = is_known, is_wanted

    @staticmethod
    def over(lower: Float[np.ndarray, "3"], upper: Float[np.ndarray, "3"], pitch: float) -> "Lattice":
        """A lattice over a box [m], of which nothing is known."""
        nodes = np.maximum(np.ceil((upper - lower) / pitch - 1e-6).astype(int), 1) + 1
        return Lattice(lower, pitch, np.zeros(nodes), np.zeros(nodes, bool), np.ones(nodes, bool))

    def halved(self, seen: Float[np.ndarray, "n 3"] | None = None) -> "Lattice":
        """The same box at half the pitch.

        Args:
            seen: points near the surface [m], around which the field is asked for, too: what is thinner than a cell can
                be missed elsewhere.
        """
        values, pitch = _doubled(self.values), self.pitch / 2
        is_known = np.zeros(values.shape, bool)
        is_known[::2, ::2, ::2] = self._is_known
        wanted = _corners_of(_repeated(_crossed(self.values)))
        if seen is not None:
            wanted |= ndimage.binary_dilation(self._nearest(seen, pitch, values.shape), np.ones((3, 3, 3), bool))
        return Lattice(self.lower, pitch, values, is_known, wanted)

    def missing(self) -> Int[np.ndarray, "n 3"]:
        """Indices of the nodes whose value is wanted and not known."""
        return np.argwhere((self._is_wanted | _corners_of(_crossed(self.values))) & ~self._is_known)

    def positions(self, nodes: Int[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Where nodes are [m]."""
        return self.lower + self.pitch * nodes

    def fill(self, nodes: Int[np.ndarray, "n 3"], values: Float[np.ndarray, "n"]) -> None:
        """Takes the field's own values at nodes."""
        index = tuple(nodes.T)
        self.values[index] = values
        self._is_known[index] = True

    def _nearest(self, points: Float[np.ndarray, "n 3"], pitch: float, shape: tuple[int, ...]) -> np.ndarray:
        """The nodes of a lattice of this pitch and shape that are next to a point; points outside are next to none."""
        nodes = np.rint((points - self.lower) / pitch).astype(np.int64)
        nodes = nodes[((nodes >= 0) & (nodes < shape)).all(axis=1)]
        nearest = np.zeros(shape, bool)
        nearest[tuple(nodes.T)] = True
        return nearest


def _crossed(values: Float[np.ndarray, "x y z"]) -> Bool[np.ndarray, "i j k"]:
    """Cells with corners of both signs."""
    some = every = values > 0
    for axis in range(3):
        (first, second), (third, fourth) = _sides(some, axis), _sides(every, axis)
        some, every = first | second, third & fourth
    return some & ~every


def _corners_of(cells: Bool[np.ndarray, "i j k"]) -> Bool[np.ndarray, "x y z"]:
    """Nodes of some cells."""
    for axis in range(3):
        padding = [(1, 1) if each == axis else (0, 0) for each in range(3)]
        first, second = _sides(np.pad(cells, padding), axis)
        cells = first | second
    return cells


def _sides(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """All along an axis but the last, and all but the first."""
    moved = np.moveaxis(values, axis, 0)
    return np.moveaxis(moved[:-1], 0, axis), np.moveaxis(moved[1:], 0, axis)


def _repeated(cells: Bool[np.ndarray, "i j k"]) -> Bool[np.ndarray, "x y z"]:
    return cells.repeat(2, 0).repeat(2, 1).repeat(2, 2)


def _doubled(values: Float[np.ndarray, "x y z"]) -> Float[np.ndarray, "i j k"]:
    """Values at twice the resolution, the new ones by linear interpolation."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        doubled = np.empty((2 * len(values) - 1, *values.shape[1:]), values.dtype)
        doubled[::2] = values
        doubled[1::2] = (values[1:] + values[:-1]) / 2
        values = np.moveaxis(doubled, 0, axis)
    return np.ascontiguousarray(values)
