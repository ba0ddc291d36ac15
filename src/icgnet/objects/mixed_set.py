"""Several object sets as one."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

from icgnet.errors import InputError
from icgnet.geometry.signed_distance import SignedDistanceGrid
from icgnet.objects.base import ObjectSet, unknown_object
from icgnet.objects.kinds import Kind, Split
from icgnet.objects.model import ObjectModel

SEPARATOR = ":"
"""Between the name of a set and the key of an object in it."""


class MixedObjectSet(ObjectSet):
    """The objects of several sets, with keys "SET:KEY"; its name joins theirs, "vgn+procedural".

    Args:
        members: the sets, each of another name.

    Raises:
        InputError: two sets of one name, or a name with the character that separates it from the keys.
    """

    def __init__(self, members: Sequence[ObjectSet]) -> None:
        names = [member.name for member in members]
        for name, count in Counter(names).items():
            if count > 1:
                raise InputError(f"{count} of the object sets to be mixed are called {name!r}")
            if SEPARATOR in name:
                raise InputError(f"an object set that is mixed with others must have a name without ':', got {name!r}")
        super().__init__("+".join(names))
        self._set_members(members)

    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        """Returns the sorted keys of the objects for scenes of `kind` in `split`."""
        return tuple(
            sorted(_key(member, name) for member in self._members.values() for name in member.names(kind, split))
        )

    def class_name(self, key: str) -> str:
        """Returns an object's class without loading it."""
        member, name = self.member_of(key)
        return member.class_name(name)

    def class_alternative(self, key: str) -> str | None:
        """Returns the class that an object could have had as well, None where its class is clear."""
        member, name = self.member_of(key)
        return member.class_alternative(name)

    def group(self, key: str) -> str:
        """Returns what an object is one of several of: its set, and its group there."""
        member, name = self.member_of(key)
        return _key(member, member.group(name))

    def fingerprint(self, key: str) -> str:
        """Returns the fingerprint that the object has in its own set."""
        member, name = self.member_of(key)
        return member.fingerprint(name)

    def signed_distance(self, key: str) -> SignedDistanceGrid:
        """Returns an object's signed-distance grid at scale 1, that of its own set."""
        member, name = self.member_of(key)
        return member.signed_distance(name)

    def notices(self) -> list[str]:
        """Returns the lines of all sets."""
        return [f"{member.name}: {line}" for member in self._members.values() for line in member.notices()]

    def without(self, left_out: Mapping[str, str]) -> "MixedObjectSet":
        """Returns the sets without some of their objects; `left_out` gives the reason for each.

        Raises:
            InputError: there is no such object.
            DataError: an object is of a set that makes its objects itself.
        """
        by_member: dict[str, dict[str, str]] = defaultdict(dict)
        for key, reason in left_out.items():
            member, name = self.member_of(key)
            by_member[member.name][name] = reason
        rest = copy(self)
        rest._set_members(
            [
                member.without(by_member[member.name]) if member.name in by_member else member
                for member in self._members.values()
            ]
        )
        return rest

    def split_keys(self, keys: Sequence[str]) -> list[tuple[ObjectSet, list[str]]]:
        """Returns the sets that some keys are of, each with its own keys.

        Raises:
            InputError: there is no such set.
        """
        by_member: dict[str, list[str]] = defaultdict(list)
        for key in keys:
            member, name = self.member_of(key)
            by_member[member.name].append(name)
        return [(self._members[name], own) for name, own in by_member.items()]

    def member_of(self, key: str) -> tuple[ObjectSet, str]:
        """Returns the set that a key names, and the rest of the key, which that set may or may not know.

        Raises:
            InputError: there is no such set.
        """
        set_name, _, name = key.partition(SEPARATOR)
        if set_name not in self._members:
            raise unknown_object(self.name, key, self.keys())
        return self._members[set_name], name

    def _set_members(self, members: Sequence[ObjectSet]) -> None:
        self._members = {member.name: member for member in members}
        self.left_out = {_key(member, name): reason for member in members for name, reason in member.left_out.items()}

    def _load(self, key: str) -> ObjectModel:
        member, name = self.member_of(key)
        return replace(member.model(name), name=key)


def _key(member: ObjectSet, name: str) -> str:
    return f"{member.name}{SEPARATOR}{name}"
