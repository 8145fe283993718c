"""The page over HTTP, for a browser on this machine or at the other end of an ssh tunnel."""

import socket
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from robot_retarget.errors import UsageError

HOST = "127.0.0.1"
"""Only this machine is served: who is elsewhere comes through ssh."""
PORT = 8410


@dataclass(frozen=True, eq=False)
class Served:
    """A page at an address."""

    server: ThreadingHTTPServer

    @property
    def address(self) -> str:
        """What to open."""
        return f"http://localhost:{self.server.server_port}/"

    def forever(self) -> None:
        """Serve until the process is interrupted."""
        try:
            self.server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def close(self) -> None:
        """Give the port back."""
        self.server.server_close()

    def way_in(self) -> str:
        """How to come from another machine."""
        return f"ssh -L {self.server.server_port}:localhost:{self.server.server_port} {socket.gethostname()}"


def serve(page: str, port: int = PORT) -> Served:
    """Open a port for a page; `forever` answers.

    Args:
        port: 0 takes one that is free.

    Raises:
        UsageError: the port is taken, or may not be used.
    """
    content = page.encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path.split("?")[0] not in ("/", "/index.html"):
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            pass  # a person at a terminal is told the address, not every request

    try:
        return Served(ThreadingHTTPServer((HOST, port), Handler))
    except (OSError, OverflowError) as error:
        raise UsageError(f"cannot serve on port {port}: {error}; --port takes another, 0 any that is free") from error
