"""The scene: nodes at rest, triangles, and what the page needs to know about a session."""

import json
import struct
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from palpate.arrays import Float64
from palpate.server.json_messages import PieceShape, Scene
from palpate.simulation.lesson import TOOLS
from palpate.simulation.session import RATE, Session
from palpate.tissue.models.registry import name_of

VIEWS = ("plain", "displacement", "strain", "stiffness", "error", "wireframe", "inside")


def reach(session: Session) -> float:
    """The longest displacement that a tool may ask for: half the organ's diagonal, mm."""
    return float(np.linalg.norm(np.ptp(session.mesh.nodes, axis=0)) / 2)


def front(session: Session) -> float:
    """The side opposite to the fixed nodes, radians about z from -y towards +x; 0 (anterior) if they are below or above."""
    nodes = session.mesh.nodes
    x, y, _ = nodes.mean(axis=0) - nodes[session.model.tissue.fixed].mean(axis=0)
    sideways = np.hypot(x, y) > 0.1 * np.ptp(nodes, axis=0)[:2].min()
    return float(np.arctan2(x, -y)) if sideways else 0.0


def lumen(session: Session) -> dict[str, list[float]]:
    """The centre line and the openings of a hollow organ, in the steps of a screen."""
    line = session.mesh.centerline
    if line is None:
        return {"lumen": [], "openings": []}
    rows = np.column_stack([line.points, line.radius, line.branch])
    return {"lumen": rows.round(2).ravel().tolist(), "openings": line.openings.round(6).ravel().tolist()}


def scene_bytes(
    session: Session,
    title: str,
    replay: bool = False,
    *,
    models: Sequence[str] = (),
    organs: Sequence[str] = (),
    organ: int = 0,
    task: str = "",
    reason: str = "",
    images: bool = False,
    depth: float = 0.0,
    tools: Sequence[str] = TOOLS,
    views: Sequence[str] = VIEWS,
    exam: bool = False,
    question: str = "",
    channel: str = "",
    place: Float64 | None = None,
    normal: Float64 | None = None,
    recorded: bool = False,
    room: str = "",
) -> bytes:
    """The scene as a message, see `messages.Scene`. normal: (3,) at the place, which is seen first."""
    drawn = session.displayed
    header = Scene(
        title=title,
        model=name_of(session.model),
        nodes=len(drawn.places),
        triangles=len(drawn.triangles),
        parts=list(drawn.parts),
        gapes=drawn.gape is not None,
        lips=list(drawn.lips),
        beside=list(drawn.beside),
        body=session.bodies,
        made=session.cuts,
        depth=depth,
        tools=list(tools),
        views=list(views),
        exam=exam,
        question=question,
        channel=channel,
        place=[] if place is None else np.round(place, 2).tolist(),
        recorded=recorded,
        **lumen(session),
        elements=len(session.mesh.tets),
        radius=session.settings.radius,
        reach=reach(session),
        limit=session.settings.limit,
        rate=RATE,
        replay=replay,
        front=front(session) if normal is None else float(np.arctan2(normal[0], -normal[1])),
        models=list(models),
        organs=list(organs),
        organ=organ,
        task=task,
        reason=reason,
        images=images,
        room=room,
        pieces=[PieceShape(len(one.places), len(one.drawn.triangles), list(one.drawn.lips)) for one in session.pieces],
    )
    text = json.dumps(asdict(header)).encode()
    text += b" " * (-len(text) % 4)
    places = [drawn.places] if drawn.gape is None else [drawn.places, drawn.gape]
    arrays = [*(np.asarray(one, "<f4") for one in places), drawn.triangles.astype("<u4")]
    arrays += [] if drawn.organ is None else [drawn.organ.astype("<u4")]
    for one in session.pieces:
        arrays += [one.drawn.places.astype("<f4"), one.places.astype("<f4"), one.drawn.triangles.astype("<u4")]
    return struct.pack("<I", len(text)) + text + b"".join(one.tobytes() for one in arrays)
