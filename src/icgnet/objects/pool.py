"""A few objects of a set: scenes are made of these and of no others."""

from collections.abc import Collection

from icgnet.geometry.signed_distance import SignedDistanceGrid
from icgnet.objects.base import ObjectSet
from icgnet.objects.kinds import Kind, Split
from icgnet.objects.model import ObjectModel


class ObjectPool(ObjectSet):
    """Another set of which only some objects are named.

    Args:
        whole: the set.
        kept: keys of the objects.
    """

    def __init__(self, whole: ObjectSet, kept: Collection[str]) -> None:
        super().__init__(whole.name, whole.left_out)
        self._whole, self._kept = whole, frozenset(kept)

    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        """Returns the sorted keys of the objects that are kept."""
        return tuple(name for name in self._whole.names(kind, split) if name in self._kept)

    def class_name(self, key: str) -> str:
        """Returns an object's class without loading it."""
        return self._whole.class_name(key)

    def class_alternative(self, key: str) -> str | None:
        """Returns the class that an object could have had as well, None where its class is clear."""
        return self._whole.class_alternative(key)

    def group(self, key: str) -> str:
        """Returns what an object is one of several of in the whole set."""
        return self._whole.group(key)

    def fingerprint(self, key: str) -> str:
        """Returns the fingerprint that the object has in the whole set."""
        return self._whole.fingerprint(key)

    def signed_distance(self, key: str) -> SignedDistanceGrid:
        """Returns an object's signed-distance grid at scale 1, that of the whole set."""
        return self._whole.signed_distance(key)

    def _load(self, key: str) -> ObjectModel:
        return self._whole.model(key)
