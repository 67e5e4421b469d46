"""What the engine in a page needs of an organ to answer as model `compliance` does here, as bytes."""

import json
import struct

import numpy as np

from palpate.errors import MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.display_surfaces import displayed_nodes
from palpate.meshes.tet_mesh import regions_by_size
from palpate.server.messages import PROTOCOL
from palpate.simulation.session import Session
from palpate.tissue.cutting import before_cuts
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.organ_gaps import organ_gaps
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.tissue import Tissue

INSTRUCTIONS = "wasm simd128"


def refuse_unfollowed(tissue: Tissue, what: str, instead: str) -> None:
    """Refuses a tissue that the engine of the page does not follow.

    what, instead: for whom, and what serves this tissue. Raises `MaterialError`.
    """
    mesh = tissue.mesh
    cut, taken = isinstance(mesh, CutMesh), isinstance(mesh, CutMesh) and any(mesh.figures.taken.values())
    for found, lacking in (
        (tissue.element != "smoothed", f'element "{tissue.element}"; fit it again: palpate fit'),
        (tissue.relaxation is not None, "a tissue that relaxes; leave out its relaxation: palpate fit"),
        (tissue.inertia is not None, "a tissue with inertia; leave it out: palpate fit"),
        (len(organ_gaps(mesh).rest) > 0 or tissue.attachments, "organs that touch"),
        (cut and tissue.surface_friction > 0, "lips that rub on each other"),
        (taken, "what was before a piece was taken away; cut it in the page"),
    ):
        if found:
            joined = ", or " if ";" in lacking else "; "
            raise MaterialError(f"{what}: the engine of the page does not have {lacking}{joined}{instead}")


def followed_model(tissue: Tissue, what: str, instead: str) -> ComplianceModel:
    """The model that the page's engine repeats. Raises as `refuse_unfollowed`."""
    refuse_unfollowed(tissue, what, instead)
    return ComplianceModel(tissue)


def predicted_solid(session: Session) -> bytes:
    """The organ for a page that predicts what this session will answer. Raises as `refuse_unfollowed`."""
    what, instead = "prediction", "wait for the room's answers"
    refuse_unfollowed(session.tissue, what, instead)
    if not isinstance(session.model, ComplianceModel):
        raise MaterialError(f"{what}: the engine of the page has model compliance only; {instead}")
    return solid_bytes(session)


def solid_bytes(session: Session) -> bytes:
    """JSON, of a length that comes first (32 bits), then the arrays that web/src/engine/touch-engine.ts reads.

    They are blade (of all cuts), node, lam, mu, toughness of the regions (float64; mm, N/mm², J/m²), tet, region, triangle,
    shown, labels of the regions by size, triangles of each cut (int32), fixed (uint8).
    """
    tissue, settings = before_cuts(session.first.tissue), session.settings
    mesh, blades = tissue.mesh, session.mesh.blades if isinstance(session.mesh, CutMesh) else ()
    shown = displayed_nodes(mesh) if blades else session.shown  # of a cut organ the engine finds them itself
    corners = np.concatenate([np.empty((0, 3, 3)), *(blade.points[blade.triangles] for blade in blades)])
    sizes = [len(blade.triangles) for blade in blades]
    labels, whole = regions_by_size(mesh), np.bincount(mesh.region, mesh.volumes)
    lam, mu = lame(tissue.young, tissue.poisson)
    tough = [settings.resistance.toughness[label] for label in labels]
    described = session.description() | {"instructions": INSTRUCTIONS}
    header = {
        "description": {name: described[name] for name in ("model", "tissue", "settings", "instructions")},
        "protocol": PROTOCOL,
        "nodes": len(mesh.nodes),
        "tets": len(mesh.tets),
        "triangles": len(mesh.surface),
        "shown": len(shown),
        "regions": len(labels),
        "parts": [
            {"name": (mesh.names or {}).get(label, f"region {label}"), "volume": float(whole[label])}
            for label in labels
        ],
        "blade": len(corners),
        "cuts": len(sizes),
        "edge": tissue.edge,
        "radius": settings.radius,
        "limit": settings.limit,
        "friction": settings.friction,
    }
    text = json.dumps(header).encode()
    arrays = [
        *(np.asarray(a, "<f8") for a in (corners, mesh.nodes, lam, mu, tough)),
        *(np.asarray(a, "<i4") for a in (mesh.tets, mesh.region, mesh.surface, shown, labels, sizes)),
        tissue.held.astype(np.uint8),
    ]
    return struct.pack("<I", len(text)) + text + b"".join(a.tobytes() for a in arrays)
