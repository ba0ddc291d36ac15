"""Readers and writers of topics of ROS 2, over Cyclone DDS."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from icgnet.errors import InputError
from icgnet.ros2.config import dds_name
from icgnet.ros2.dds import (
    DataReader,
    DataWriter,
    DDSException,
    DomainParticipant,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    Topic,
    ViewState,
    WaitSet,
)

Message = TypeVar("Message")

BLOCKING = 100_000_000
"""A writer waits so long for a slow reader before it gives up [ns]."""
MOST_AT_ONCE = 100


def sensor_data(depth: int = 1) -> Qos:
    """As sensors publish: the newest matter, and lost ones are not sent again. Matches writers of either kind."""
    return Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(depth))


def reliable(depth: int = 10, is_latched: bool = False) -> Qos:
    """What was lost is sent again; what is latched is also sent to readers that come later."""
    durability = Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile
    return Qos(Policy.Reliability.Reliable(BLOCKING), durability, Policy.History.KeepLast(depth))


class Reader(Generic[Message]):
    """What comes in on one topic.

    Args:
        bus: the domain.
        topic: name in ROS.
        kind: of the messages.
        qos: how they are wanted.
    """

    def __init__(self, bus: "Bus", topic: str, kind: type[Message], qos: Qos) -> None:
        self.topic, self._kind = topic, kind
        self._reader: DataReader[Any] = DataReader(bus.participant, bus.topic(topic, kind), qos=qos)
        self._news = ReadCondition(self._reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)
        bus.waiting.attach(self._news)

    @property
    def writers(self) -> int:
        """How many write on the topic."""
        return len(self._reader.get_matched_publications())

    def take(self, complain: Callable[[str], None]) -> list[Message]:
        """What has come since, oldest first; what cannot be read is left out after a line about it."""
        try:
            samples = self._reader.take(MOST_AT_ONCE)
        except Exception as error:  # bytes of another definition can raise anything
            complain(f"a message on {self.topic} is not of the type {self._kind.__name__}: {error}")
            return []
        # Beside messages it tells of writers that went away.
        return [each for each in samples if isinstance(each, self._kind)]


class Writer(Generic[Message]):
    """What goes out on one topic; arguments as of `Reader`."""

    def __init__(self, bus: "Bus", topic: str, kind: type[Message], qos: Qos) -> None:
        self.topic = topic
        self._writer = DataWriter(bus.participant, bus.topic(topic, kind), qos=qos)

    @property
    def is_heard(self) -> bool:
        """Whether anybody reads the topic."""
        return bool(self._writer.get_matched_subscriptions())

    def write(self, message: Message) -> None:
        """Sends a message.

        Raises:
            InputError: a reader is so slow that there is no room left.
        """
        try:
            self._writer.write(message)
        except DDSException as error:
            raise InputError(f"cannot send on {self.topic}: {error.msg}") from error


class Bus:
    """A member of a DDS domain.

    Args:
        domain: its number.

    Raises:
        InputError: it cannot be joined: no network, or a CYCLONEDDS_URI with mistakes.
    """

    def __init__(self, domain: int) -> None:
        try:
            self.participant = DomainParticipant(domain)
        except DDSException as error:
            raise InputError(f"cannot join the DDS domain {domain}: {error.msg}; see CYCLONEDDS_URI") from error
        self.waiting = WaitSet(self.participant)
        self._topics: dict[str, Topic[Any]] = {}

    def topic(self, name: str, kind: type) -> "Topic[Any]":
        """The topic of this name in ROS."""
        if name not in self._topics:
            self._topics[name] = Topic(self.participant, dds_name(name), kind)
        return self._topics[name]

    def wait(self, seconds: float) -> None:
        """Waits until something comes in, or for this time [s]."""
        self.waiting.wait(int(1e9 * seconds))
