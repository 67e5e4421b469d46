"""What the engine in a page needs of an organ, as bytes."""

import json
import struct

import numpy as np

from palpate.errors import MaterialError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.server.scene_message import scene_bytes
from palpate.simulation.session import Session
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.tissue import Tissue

INSTRUCTIONS = "wasm simd128"


def session_of(tissue: Tissue, radius: float | None = None) -> Session:
    """A session of model `compliance`, which the page's engine repeats.

    Raises `MaterialError` for a tissue that the engine does not follow, `DataError` for a radius that is too large.
    """
    refuse_cut(tissue.mesh, "export", "serve it: palpate touch")
    for found, what in (
        (tissue.element != "smoothed", f'element "{tissue.element}"; fit it again: palpate fit'),
        (tissue.relaxation is not None, "a tissue that relaxes; leave out its relaxation: palpate fit"),
        (tissue.inertia is not None, "a tissue with inertia; leave it out: palpate fit"),
    ):
        if found:
            raise MaterialError(f"export: the engine of the page does not have {what}, or serve it: palpate touch")
    model = ComplianceModel(tissue)
    if model.gaps is not None:
        raise MaterialError("export: the engine of the page does not have organs that touch; serve it: palpate touch")
    return Session(model, radius=radius, sweeps=1)


def organ_data(session: Session, title: str, task: str = "") -> bytes:
    """The scene as the server sends it, then the solid.

    Both begin with their length, 32 bits. The solid is JSON of a length that comes first, then the arrays node, lam, mu
    (float64; mm, N/mm²), tet, region, triangle, shown (int32), fixed (uint8); web/src/engine reads them.
    """
    mesh, tissue, settings = session.mesh, session.model.tissue, session.settings
    lam, mu = lame(tissue.young, tissue.poisson)
    described = session.description() | {"instructions": INSTRUCTIONS}
    header = {
        "description": {name: described[name] for name in ("model", "tissue", "settings", "instructions")},
        "nodes": len(mesh.nodes),
        "tets": len(mesh.tets),
        "triangles": len(mesh.surface),
        "shown": len(session.shown),
        "radius": settings.radius,
        "limit": settings.limit,
        "friction": settings.friction,
    }
    text = json.dumps(header).encode()
    arrays = [
        *(np.asarray(a, "<f8") for a in (mesh.nodes, lam, mu)),
        *(np.asarray(a, "<i4") for a in (mesh.tets, mesh.region, mesh.surface, session.shown)),
        tissue.held.astype(np.uint8),
    ]
    solid = struct.pack("<I", len(text)) + text + b"".join(a.tobytes() for a in arrays)
    scene = scene_bytes(session, title, task=task)
    return b"".join(struct.pack("<I", len(part)) + part for part in (scene, solid))
