"""Serves volumes as slices, and scans as projections."""

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
from palpate.server.access_control import by_token, page_application
from palpate.server.access_token import access_token
from palpate.server.image_payloads import MAX_VOXELS, ImagePayload, scan_payload, volume_payload
from palpate.server.json_messages import Album
from palpate.server.loopback_server import running
from palpate.volumes.volume import Volume

CHUNK = 1 << 22  # bytes


def image_payloads(
    images: Sequence[Volume | Scan], titles: Sequence[str], water: float | None = None, most: int = MAX_VOXELS
) -> list[ImagePayload]:
    """The images as sent to the page, of at most so many voxels. Raises `DataError`."""
    if len({isinstance(image, Scan) for image in images}) > 1:
        raise DataError("view: a scan and a volume cannot be compared; give two scans or two volumes")
    if water is not None and not 0 < water < 1:
        raise DataError(
            f"water: {water!r} 1/mm, expected an attenuation between 0 and 1; about 0.02 for CT, 0.05 for mammography"
        )
    return [
        scan_payload(image, title, most) if isinstance(image, Scan) else volume_payload(image, title, water, most)
        for image, title in zip(images, titles, strict=False)
    ]


@contextlib.contextmanager
def serving_images(payloads: Sequence[ImagePayload], listener: socket.socket) -> Iterator[str]:
    """Serves the page for these images in a thread during the block. Yields its address."""
    token = access_token()
    with running(application(payloads, token), listener) as address:
        yield f"{address}?token={token}"


def application(payloads: Sequence[ImagePayload], token: str) -> Starlette:
    """The application: the page, the list of images, and their values. Raises `FileError` if the page is missing."""
    return page_application("view.html", image_routes(payloads), by_token(token))


def image_routes(payloads: Sequence[ImagePayload]) -> list[Route]:
    """Routes of the list of images and of their values."""
    album = json.loads(json.dumps(asdict(Album([payload.image for payload in payloads]))))

    async def listing(request: Request) -> Response:
        return JSONResponse(album)

    async def values(request: Request) -> Response:
        image, stack = request.path_params["image"], request.path_params["stack"]
        if not (0 <= image < len(payloads) and 0 <= stack < len(payloads[image].values)):
            return Response(f"image {image}, stack {stack}: not there; reload the page", status_code=404)
        data = memoryview(payloads[image].values[stack].reshape(-1)).cast("B")

        async def parts() -> AsyncIterator[bytes]:
            for at in range(0, len(data), CHUNK):
                yield bytes(data[at : at + CHUNK])

        length = {"Content-Length": str(len(data))}
        return StreamingResponse(parts(), media_type="application/octet-stream", headers=length)

    return [Route("/album", listing), Route("/values/{image:int}/{stack:int}", values)]
