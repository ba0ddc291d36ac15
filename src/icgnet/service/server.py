"""Runs the application until the process is told to stop."""

import os
import socket
from collections.abc import Callable

import uvicorn

from icgnet.errors import InputError
from icgnet.service.app import Service, create_app

MOST_CONNECTIONS = 256
"""More are answered with 503."""
WAITING_CONNECTIONS = 128
"""So many wait to be accepted; the system refuses more."""
IDLE_SECONDS = 30
"""A connection without requests is closed after this time."""


class Server(uvicorn.Server):
    """Answers requests; when told to stop it finishes the prediction that runs and drops those that wait."""

    def __init__(self, service: Service, token: str | None = None) -> None:
        self._worker = service.worker
        config = uvicorn.Config(
            create_app(service, token),
            log_level="warning",
            access_log=False,
            server_header=False,
            limit_concurrency=MOST_CONNECTIONS,
            timeout_keep_alive=IDLE_SECONDS,
            ws="none",
            proxy_headers=False,
        )
        super().__init__(config)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stops the worker before it waits for the answers that are on their way."""
        self._worker.stop()
        await super().shutdown(sockets)


def serve(service: Service, token: str | None, listening: Callable[[str], None]) -> None:
    """Answers requests until SIGINT or SIGTERM.

    Args:
        service: what is served.
        token: see `create_app`.
        listening: is told the address once requests can come.

    Raises:
        InputError: nothing can listen there, or the token is missing or bad.
    """
    server = Server(service, token)
    with listen(service.config.host, service.config.port) as opened:
        host = f"[{service.config.host}]" if ":" in service.config.host else service.config.host
        listening(f"http://{host}:{opened.getsockname()[1]}")
        server.run([opened])


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens there; connections wait in it until they are answered.

    Raises:
        InputError: the address is taken, or is none of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Named as TCP, for asyncio lets answers go out at once only then; else each would wait 40 ms for a receipt.
    opened = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if os.name == "posix":  # elsewhere it would let two services share a port
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((host, port))
        opened.listen(WAITING_CONNECTIONS)
    except OSError as error:
        opened.close()
        raise InputError(f"cannot listen on {host}, port {port}: {error.strerror or error}") from error
    return opened
