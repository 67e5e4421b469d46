"""Access control of all pages: the host's name, the origin, a token, and a content security policy."""

import re
import secrets
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path

from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from palpate.errors import FileError

STATIC = Path(__file__).parent / "static"
LOOPBACK = frozenset({"localhost", "127.0.0.1", "[::1]"})
AUTHORITY = r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(:[0-9]{1,5})?"  # host and port
HOST, ORIGIN = re.compile(AUTHORITY), re.compile(rf"null|[A-Za-z][A-Za-z0-9+.-]*://(?P<authority>{AUTHORITY})")
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
# A worker has a policy of its own. This one compiles the engine, and asks nobody for anything.
PREDICTION, PREDICTION_POLICY = "/static/predict.js", "default-src 'none'; script-src 'wasm-unsafe-eval'"
WAY_OUT = "open the address that palpate printed when it started"


def check_page() -> None:
    """Raises `FileError` if the pages are not bundled."""
    if not (STATIC / "index.html").is_file():
        raise FileError(
            f"{STATIC}: the web page is missing; install the wheel, or build it with: python web/build.py {STATIC}"
        )


@dataclass(frozen=True)
class Admission:
    """Who is let in. refused: says of a token why it lets nobody in, or nothing. hosts: names that the server goes by."""

    refused: Callable[[str], str]
    hosts: frozenset[str] = LOOPBACK


def by_token(token: str) -> Admission:
    """Admission on loopback by one token."""

    def refused(given: str) -> str:
        right = secrets.compare_digest(given.encode(), token.encode())
        return "" if right else f"the token is wrong; {WAY_OUT}"

    return Admission(refused)


def page_application(
    name: str,
    routes: Sequence[BaseRoute],
    admission: Admission,
    lifespan: Callable[[Starlette], AbstractAsyncContextManager[None]] | None = None,
) -> Starlette:
    """An application that serves the page `name`, its static files and `routes`. Raises `FileError` if it is missing."""
    check_page()

    async def page(request: Request) -> Response:
        return HTMLResponse((STATIC / name).read_bytes())

    app = Starlette(
        routes=[Route("/", page), *routes, Mount("/static", StaticFiles(directory=STATIC))],
        middleware=[Middleware(AccessControl)],
        lifespan=lifespan,
    )
    app.state.admission = admission
    return app


class AccessControl:
    """ASGI middleware: refuses strangers before anything else sees the request, and adds the security headers."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request or a WebSocket's handshake, or passes it on."""

        async def send_with_headers(message: Message) -> None:
            if message["type"].endswith("http.response.start"):
                headers = MutableHeaders(scope=message)
                headers.update(HEADERS)
                if scope["path"] == PREDICTION:
                    headers["Content-Security-Policy"] = PREDICTION_POLICY
            await send(message)

        refused = None if scope["type"] == "lifespan" else refusal(HTTPConnection(scope))
        answer = self.app if refused is None else PlainTextResponse(f"refused: {refused[1]}", refused[0])
        await answer(scope, receive, send_with_headers)


def refusal(connection: HTTPConnection) -> tuple[int, str] | None:
    """Status and reason of a refusal, or None. The browser sets Host and Origin; a page of another site cannot forge them.

    The page and its static files hold no data and need no token: a page that is loaded again has it no longer in its
    address. A wrong one is refused there too.
    """
    hosts, origins = connection.headers.getlist("host"), connection.headers.getlist("origin")
    host = HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
    if host is None:
        return 400, "expected one header Host with the name of a host"
    admission: Admission = connection.app.state.admission
    if host[1].lower() not in admission.hosts:
        known = "a loopback address" if admission.hosts == LOOPBACK else "a name of this server"
        return 403, f"host {hosts[0]!r} is not {known}; {WAY_OUT}"
    if origins:
        origin = ORIGIN.fullmatch(origins[0]) if len(origins) == 1 else None
        if origin is None:
            return 400, "expected at most one header Origin with an origin"
        if origin["authority"] != hosts[0]:
            return 403, f"origin {origins[0]!r} is not this server; {WAY_OUT}"
    token, path = connection.query_params.get("token"), connection.scope["path"]
    if token is None and (path == "/" or path.startswith("/static/")):
        return None
    why = admission.refused(token or "")
    return (403, why) if why else None
