"""Pages over HTTP, for a browser on this machine or at the other end of an ssh tunnel: uvicorn and Starlette behind one guard.

A request needs the token of the address and a host name of this machine. The origin of a page's request is the page itself. A request
has one deadline, and its body has a largest size.
"""

import secrets
import socket
from asyncio import TimerHandle
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn import Config, Server
from uvicorn.protocols.http.h11_impl import H11Protocol

from robot_retarget.base.errors import RobotRetargetError, UsageError
from robot_retarget.base.untrusted.documents import parse_json

HOST = "127.0.0.1"
"""Only this machine is served; other machines connect through ssh."""
PORT = 8410
LARGEST_MESSAGE = 1_000_000
"""Longest message from a page [bytes]: a thousand keyframes of forty joints."""
UPLOAD = "/drop"
"""Path of the requests that bring a file."""
LARGEST = 200_000_000
"""Largest file that a page may send [bytes]: an hour of a BVH at 60 frames a second has 150 MB."""
DEADLINE = 10.0
"""Longest time from a connection, or from the answer before, to the end of a request [s];"""
UPLOAD_PATIENCE = 120.0
"""of a request that brings a file [s]: a file of the largest size at 13 Mbit/s."""
OWN = {"localhost", "127.0.0.1", "::1"}
"""Names of this machine. Requests under another host name are refused, which stops DNS rebinding."""
POLICY = (
    "default-src 'none'; script-src 'nonce-{}' data:; style-src 'unsafe-inline'; img-src data: blob:; media-src blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: the page loads and runs its own modules only."""
HEADERS = {
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Headers of every answer: no frame shows the page, no cache keeps it, and no link passes on its address."""


@dataclass(frozen=True, eq=False)
class Served:
    """A page at an address."""

    listening: socket.socket
    app: Starlette
    token: str
    """A token in its address; requests without it get status 403."""

    @property
    def port(self) -> int:
        """Its port."""
        return int(self.listening.getsockname()[1])

    @property
    def address(self) -> str:
        """URL of the page."""
        return f"http://localhost:{self.port}/?token={self.token}"

    @cached_property
    def _server(self) -> Server:
        how: dict[str, Any] = {"log_level": "critical", "access_log": False, "server_header": False}
        how |= {"timeout_graceful_shutdown": 1}  # a page that follows events keeps its connection open
        return Server(Config(self.app, http=InTime, ws="none", lifespan="off", **how))

    def forever(self) -> None:
        """Serve until an interrupt or `close`."""
        with suppress(KeyboardInterrupt), self.listening:
            self._server.run(sockets=[self.listening])

    def close(self) -> None:
        """End `forever`."""
        self._server.should_exit = True

    def tunnel_command(self) -> str:
        """Return the ssh command that forwards the port to another machine."""
        return f"ssh -L {self.port}:localhost:{self.port} {socket.gethostname()}"


class InTime(H11Protocol):
    """A connection that closes when a request is incomplete at its deadline."""

    due: TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._expect(DEADLINE)

    def data_received(self, data: bytes) -> None:
        known = self.cycle
        super().data_received(data)
        if self.cycle is None or (self.cycle is known and self.cycle.more_body):
            return
        if not self.cycle.more_body:
            self._expect(None)
        elif self.scope["path"] == UPLOAD:
            self._expect(UPLOAD_PATIENCE)

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._expect(DEADLINE)

    def connection_lost(self, exc: Exception | None) -> None:
        self._expect(None)
        super().connection_lost(exc)

    def _expect(self, seconds: float | None) -> None:
        """Close the connection after a time [s] without another call; None sets no deadline."""
        if self.due is not None:
            self.due.cancel()
        self.due = None if seconds is None else self.loop.call_later(seconds, self.transport.close)


class OwnPageOnly:
    """Passes on requests of the page, refuses others, and adds `HEADERS` to every answer."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
                headers.setdefault("Content-Security-Policy", "frame-ancestors 'none'")
            await send(message)

        why = self._refused(Headers(scope=scope), scope)
        await (Response(why, 403, media_type="text/plain") if why else self._app)(scope, receive, sent)

    def _refused(self, headers: Headers, scope: Scope) -> str:
        host, origin = headers.get("host", ""), headers.get("origin")
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if _host_of(f"//{host}") not in OWN or origin not in (None, f"http://{host}"):
            return "only this page is answered"
        if not secrets.compare_digest(given.encode(), self._token.encode()):
            return "open the address that the command prints: it has a token"
        return ""


def _host_of(url: str) -> str:
    """Return the host name of a URL, or an empty text."""
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


async def message_of(request: Request) -> Any:
    """Return the JSON that a page sent.

    Raises:
        UsageError: it is no JSON.
        HTTPException: it is too long (413), or its content type is not JSON, as that of another site's form (404).
    """
    if not request.headers.get("content-type", "").startswith("application/json"):
        raise HTTPException(404)
    content = b""
    if int(request.headers.get("content-length", 0)) <= LARGEST_MESSAGE:
        async for piece in request.stream():
            content += piece
            if len(content) > LARGEST_MESSAGE:
                break
        else:
            return parse_json(content.decode(), "the message", UsageError)
    raise HTTPException(413, f"a message has at most {LARGEST_MESSAGE} bytes")


def serve(page: Callable[[str], str], routes: Sequence[BaseRoute] = (), port: int = PORT) -> Served:
    """Open a port for a page; `forever` answers.

    Args:
        page: returns the HTML, from the nonce of its scripts.
        routes: the routes of the page's requests.
        port: 0 selects a free port.

    Raises:
        UsageError: the port is taken, or may not be used.
    """

    def shown(request: Request) -> Response:
        nonce = secrets.token_urlsafe(16)
        return HTMLResponse(page(nonce), headers={"Content-Security-Policy": POLICY.format(nonce)})

    token, listening = secrets.token_urlsafe(16), socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    app = Starlette(
        routes=[*(Route(path, shown) for path in ("/", "/index.html")), *routes],
        middleware=[Middleware(OwnPageOnly, token=token)],
        exception_handlers={RobotRetargetError: _mistaken, ValueError: _mistaken, Exception: _defect},
    )
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((HOST, port))
        listening.listen(128)  # from now on the address answers
    except (OSError, OverflowError) as error:
        listening.close()
        raise UsageError(f"cannot serve on port {port}: {error}; --port takes another, 0 any that is free") from error
    return Served(listening, app, token)


async def _mistaken(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, 400)


async def _defect(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": f"a defect of robot-retarget: {type(error).__name__}: {error}"}, 500)
