"""An organ that a page holds by itself: the scene, then the solid, as bytes."""

import struct

from palpate.server.scene_message import scene_bytes
from palpate.server.solid_message import followed_model, solid_bytes
from palpate.simulation.session import Session
from palpate.tissue.tissue import Tissue


def session_of(tissue: Tissue, radius: float | None = None) -> Session:
    """A session of model `compliance`, which the page's engine repeats.

    Raises `MaterialError` for a tissue that the engine does not follow, `DataError` for a radius that is too large.
    """
    return Session(followed_model(tissue, "export", "serve it: palpate touch"), radius=radius, sweeps=1)


def organ_data(session: Session, title: str, task: str = "") -> bytes:
    """The scene as the server sends it, then the solid. Both begin with their length, 32 bits."""
    parts = scene_bytes(session, title, task=task), solid_bytes(session)
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)
