"""The packages of the extra `icgnet[ros2]`, or one line that says how to install them.

Cyclone DDS is the library below `rmw_cyclonedds_cpp`, and is configured by the same variable, CYCLONEDDS_URI. It is
imported in this folder only.
"""

from collections.abc import Sequence
from typing import Annotated, Any, get_args

from icgnet.errors import MissingExtraError

try:
    from cyclonedds.core import (
        DDSException,
        InstanceState,
        Policy,
        Qos,
        ReadCondition,
        SampleState,
        ViewState,
        WaitSet,
    )
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl import types as idl_types
    from cyclonedds.idl.types import float32, float64, int32, uint8, uint32
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
except ModuleNotFoundError as error:
    raise MissingExtraError(
        f'icgnet ros2 needs the package {error.name}, which is not installed: pip install "icgnet[ros2]"'
    ) from error


class _Lists:
    """Lists of a type, as the library makes them, but of the Sequence that is not deprecated.

    Args:
        kind: of lists in the library.
    """

    def __init__(self, kind: Any) -> None:
        self._kind = kind

    def __getitem__(self, of: Any) -> Any:
        plain, *about = get_args(self._kind[of])
        return Annotated[Sequence[get_args(plain)[0]], *about]


# What the library says of them to type checkers is that they are no lists.
array: Any = _Lists(idl_types.array)
sequence: Any = _Lists(idl_types.sequence)

__all__ = [
    "DDSException",
    "DataReader",
    "DataWriter",
    "DomainParticipant",
    "IdlStruct",
    "InstanceState",
    "Policy",
    "Qos",
    "ReadCondition",
    "SampleState",
    "Topic",
    "ViewState",
    "WaitSet",
    "array",
    "float32",
    "float64",
    "int32",
    "sequence",
    "uint8",
    "uint32",
]
