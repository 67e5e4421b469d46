"""Opens volumes and scans as slices and projections in the browser."""

import contextlib
import json
import socket
from collections.abc import AsyncIterator, Iterator, Sequence
from dataclasses import asdict

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from palpate.errors import DataError
from palpate.scans.scan import Scan
from palpate.server.guard import check_page, guarded, stranger
from palpate.server.images import Shown, shown_scan, shown_volume
from palpate.server.listen import announce, end_asked, loopback_socket, new_token, running, show
from palpate.server.messages import Album
from palpate.volumes.volume import Volume

CHUNK = 1 << 22  # bytes


def view(
    shown: Volume | Scan,
    other: Volume | Scan | None = None,
    *,
    water: float | None = None,
    titles: Sequence[str] = ("A", "B"),
    port: int | None = None,
    open_browser: bool = True,
) -> None:
    """Opens a volume or a scan in the browser, or two side by side, linked, and stays until Ctrl-C.

    water: the attenuation of water, 1/mm, so that attenuation is read in HU too. titles: of the two. port: on loopback
    (default: the first free one from 8765 on). Raises `DataError` for a volume beside a scan, or water that cannot be;
    `PortError` if the port is taken.
    """
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        things = images([shown] if other is None else [shown, other], titles, water)
        with end_asked() as ended, serving_images(things, listener) as address:
            announce(address, "look at it", [])
            show(address, ended, open_browser)
    print("\npalpate: closed")


def images(shown: Sequence[Volume | Scan], titles: Sequence[str], water: float | None = None) -> list[Shown]:
    """What the page gets of each. Raises `DataError`."""
    if len({isinstance(thing, Scan) for thing in shown}) > 1:
        raise DataError("view: a scan and a volume cannot be compared; give two scans or two volumes")
    if water is not None and not 0 < water < 1:
        raise DataError(f"water: {water!r} 1/mm cannot be its attenuation; about 0.02 for CT, 0.05 for mammography")
    return [
        shown_scan(thing, title) if isinstance(thing, Scan) else shown_volume(thing, title, water)
        for thing, title in zip(shown, titles, strict=False)
    ]


@contextlib.contextmanager
def serving_images(things: Sequence[Shown], listener: socket.socket) -> Iterator[str]:
    """Serves the page for `things` in a thread while the block lasts. Gives its address."""
    with running(application(things, new_token()), listener) as address:
        yield address


def application(things: Sequence[Shown], token: str) -> Starlette:
    """The app: the page, what there is to view, and the values. Raises `FileError` if the page was not bundled."""
    return guarded("view.html", image_routes(things), token)


def image_routes(things: Sequence[Shown]) -> list[Route]:
    """What there is to view, and its values."""
    album = json.loads(json.dumps(asdict(Album([thing.image for thing in things]))))

    async def listing(request: Request) -> Response:
        if reason := stranger(request):
            return Response(f"refused: {reason}", status_code=403)
        return JSONResponse(album)

    async def values(request: Request) -> Response:
        if reason := stranger(request):
            return Response(f"refused: {reason}", status_code=403)
        image, stack = request.path_params["image"], request.path_params["stack"]
        if not (0 <= image < len(things) and 0 <= stack < len(things[image].values)):
            return Response("no such values", status_code=404)
        data = memoryview(things[image].values[stack].reshape(-1)).cast("B")

        async def parts() -> AsyncIterator[bytes]:
            for at in range(0, len(data), CHUNK):
                yield bytes(data[at : at + CHUNK])

        length = {"Content-Length": str(len(data))}
        return StreamingResponse(parts(), media_type="application/octet-stream", headers=length)

    return [Route("/album", listing), Route("/values/{image:int}/{stack:int}", values)]
