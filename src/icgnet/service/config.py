"""Settings of the service."""

from dataclasses import dataclass

from icgnet.errors import InputError
from icgnet.settings import check_range

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Addresses that only this machine reaches."""
SHORTEST_TOKEN = 16
"""Fewer characters can be guessed."""


@dataclass(frozen=True)
class ServiceConfig:
    """Where the service listens, and how much it takes."""

    host: str = "127.0.0.1"
    """Address to listen on; any but this machine's own (127.0.0.1, localhost, ::1) needs the environment variable
    ICGNET_TOKEN."""
    port: int = 8000
    """Port to listen on; 0 takes any free one."""
    queue: int = 4
    """Requests that may wait beside the one that runs; more are answered with 429."""
    deadline_ms: float | None = None
    """Time for a request from its first byte on [ms], where it does not say itself; None for as long as it takes."""
    max_megabytes: float = 32.0
    """Larger bodies are answered with 413 [10^6 bytes]."""
    max_points: int = 4_000_000
    """Larger clouds and images are refused [points or pixels]."""
    body_seconds: float = 10.0
    """Within this time a body must have come [s]; otherwise 408."""

    def __post_init__(self) -> None:
        if not self.host.strip():
            raise InputError(f"host must be an address to listen on, got {self.host!r}")
        check_range(self, 0.0, "port", most=65535.0)
        check_range(self, 0.0, "queue", most=1000.0)
        check_range(self, 1.0, "deadline_ms")
        check_range(self, 0.001, "max_megabytes", most=1000.0)
        check_range(self, 100.0, "max_points", most=1e8)
        check_range(self, 0.1, "body_seconds", most=3600.0)

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach the service."""
        return self.host in LOOPBACK

    @property
    def max_bytes(self) -> int:
        """The largest body [bytes]."""
        return int(1e6 * self.max_megabytes)

    def check_token(self, token: str | None) -> None:
        """Makes sure that a service which others can reach has a token, and that it is a good one.

        Raises:
            InputError: it has none, or one that is short or that no header can carry.
        """
        if token is None:
            if not self.is_local:
                raise InputError(
                    f"host {self.host} can be reached from other machines: set the environment variable ICGNET_TOKEN "
                    f"to a token of at least {SHORTEST_TOKEN} characters, or listen on one of {', '.join(LOOPBACK)}"
                )
        elif len(token) < SHORTEST_TOKEN or not all("!" <= letter <= "~" for letter in token):
            raise InputError(
                f"ICGNET_TOKEN must be at least {SHORTEST_TOKEN} printable ASCII characters without blanks, "
                f"got {len(token)} characters"
            )
