"""The scene: nodes at rest, triangles, and what the page needs to know about a session."""

import json
import struct
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from palpate.meshes.display_surfaces import region_faces
from palpate.server.messages import Part, Scene
from palpate.simulation.session import RATE, Session
from palpate.tissue.models.registry import name_of


def reach(session: Session) -> float:
    """The longest displacement that a tool may ask for: half the organ's diagonal, mm."""
    return float(np.linalg.norm(np.ptp(session.mesh.nodes, axis=0)) / 2)


def front(session: Session) -> float:
    """The side opposite to the fixed nodes, radians about z from -y towards +x; 0 (anterior) if they are below or above."""
    nodes = session.mesh.nodes
    x, y, _ = nodes.mean(axis=0) - nodes[session.model.tissue.fixed].mean(axis=0)
    sideways = np.hypot(x, y) > 0.1 * np.ptp(nodes, axis=0)[:2].min()
    return float(np.arctan2(x, -y)) if sideways else 0.0


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
) -> bytes:
    """The scene as a message, see `messages.Scene`."""
    mesh, shown = session.mesh, session.shown
    groups = [("organ", mesh.surface, False)]
    groups += [(mesh.names.get(k, f"region {k}"), faces, True) for k, faces in region_faces(mesh).items()]
    first = np.concatenate([[0], np.cumsum([len(faces) for _, faces, _ in groups])])
    header = Scene(
        title=title,
        model=name_of(session.model),
        nodes=len(shown),
        triangles=int(first[-1]),
        parts=[Part(name, int(first[i]), len(faces), inside) for i, (name, faces, inside) in enumerate(groups)],
        elements=len(mesh.tets),
        radius=session.settings.radius,
        reach=reach(session),
        limit=session.settings.limit,
        rate=RATE,
        replay=replay,
        front=front(session),
        models=list(models),
        organs=list(organs),
        organ=organ,
        task=task,
        reason=reason,
        images=images,
    )
    text = json.dumps(asdict(header)).encode()
    text += b" " * (-len(text) % 4)
    triangles = np.searchsorted(shown, np.concatenate([faces for _, faces, _ in groups])).astype("<u4")
    return struct.pack("<I", len(text)) + text + mesh.nodes[shown].astype("<f4").tobytes() + triangles.tobytes()
