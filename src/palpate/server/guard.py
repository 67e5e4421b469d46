"""Who is let in, and what may run in a page: loopback, a token, an origin, a policy. Shared by all that palpate serves."""

import secrets
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from palpate.errors import FileError

STATIC = Path(__file__).parent / "static"
LOOPBACK = {"localhost", "127.0.0.1", "::1"}
POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def check_page() -> None:
    """Raises `FileError` if the pages were not bundled."""
    if not (STATIC / "index.html").is_file():
        raise FileError(f"{STATIC}: the page is not bundled here; install the wheel, or: python web/build.py {STATIC}")


def guarded(
    name: str,
    routes: Sequence[BaseRoute],
    token: str,
    lifespan: Callable[[Starlette], AbstractAsyncContextManager[None]] | None = None,
) -> Starlette:
    """An app that serves the page `name`, its parts and `routes`. Raises `FileError` if it was not bundled."""
    check_page()

    async def page(request: Request) -> Response:
        if reason := stranger(request):
            return HTMLResponse(f"<!doctype html><title>palpate</title><p>Refused: {reason}</p>", status_code=403)
        return HTMLResponse((STATIC / name).read_bytes())

    app = Starlette(
        routes=[Route("/", page), *routes, Mount("/static", StaticFiles(directory=STATIC))],
        middleware=[Middleware(BaseHTTPMiddleware, dispatch=headers)],
        lifespan=lifespan,
    )
    app.state.token = token
    return app


async def headers(request: Request, answer: RequestResponseEndpoint) -> Response:
    """Nothing from elsewhere runs in the page, and its address (the token) leaves with no request."""
    response = await answer(request)
    response.headers["Content-Security-Policy"] = POLICY
    response.headers["Referrer-Policy"] = "no-referrer"
    response.headers["X-Content-Type-Options"] = "nosniff"
    response.headers["Cache-Control"] = "no-store"
    return response


def stranger(connection: HTTPConnection) -> str | None:
    """Why a request is refused, or None. A browser sends Host and Origin itself: a foreign page cannot choose them."""
    host = connection.headers.get("host", "")
    if urlsplit(f"//{host}").hostname not in LOOPBACK:
        return f"host {host!r} is not this machine's loopback"
    origin = connection.headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return f"origin {origin!r} is not this server"
    token: str = connection.app.state.token
    if not secrets.compare_digest(connection.query_params.get("token", "").encode(), token.encode()):
        return "the token is wrong; open the address that palpate printed when it started"
    return None
