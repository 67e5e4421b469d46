"""The viewer's page with the images in it."""

import json
from collections.abc import Sequence
from dataclasses import asdict

from palpate.server.image_payloads import ImagePayload
from palpate.server.json_messages import Album
from palpate.standalone.embedded_page import embedded_page, packed

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
    "form-action 'none'"
)
LEVEL = 3  # of gzip: values with noise hardly get smaller


def image_page(payloads: Sequence[ImagePayload], host: str = "") -> str:
    """A page of slices or projections, without the rendering. host: as in `embedded_page`. Raises `FileError`."""
    album = Album([payload.image for payload in payloads])
    parts = {"album": json.dumps(asdict(album)).replace("<", r"\u003c")}  # so that no title ends the element
    for i, payload in enumerate(payloads):
        for s, values in enumerate(payload.values):
            parts[f"values-{i}-{s}"] = packed(values.tobytes(), LEVEL)
    title = ", ".join(payload.image.title for payload in payloads)
    return embedded_page("view.html", title, POLICY, "view-file.js", parts, "palpate, Apache-2.0.", host)
