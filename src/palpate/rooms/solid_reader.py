"""The organ of a room at a site that predicts what the room will answer, from what `solid_message` has written."""

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from palpate.errors import DataError, PalpateError
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.tet_mesh import TetMesh
from palpate.server.messages import PROTOCOL
from palpate.simulation.session import Session
from palpate.tissue.cutting import cut
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.tissue import KPA, Tissue

REFUSED = "the room's organ cannot be read; install the version of palpate that the room has"


@dataclass(frozen=True, eq=False)
class RoomOrgan:
    """tissue: before its cuts. blades: of the cuts, in order. toughness: of its regions, J/m². blade_friction: N/mm.

    body: the bytes that all but the cuts have come as.
    """

    tissue: Tissue
    blades: tuple[Blade, ...]
    radius: float
    limit: float
    friction: float
    toughness: dict[int | str, float]
    blade_friction: float
    body: bytes

    def session(self) -> Session:
        """A session of model `compliance` on the organ, with its cuts. Raises `PalpateError` if it cannot be."""
        tissue = self.tissue
        for blade in self.blades:
            tissue = cut(tissue, blade)
        return Session(
            ComplianceModel(tissue),
            radius=self.radius,
            limit=self.limit,
            friction=self.friction,
            regions=False,
            toughness=self.toughness,
            blade_friction=self.blade_friction,
        )

    def cuts_from(self, before: "RoomOrgan", session: Session) -> list[Callable[[], bool]] | None:
        """What `session`, of the organ before, has to do to become this one, each until it is True; None if it cannot."""
        ours, theirs = self.blades, before.blades
        same = next((i for i, pair in enumerate(zip(ours, theirs, strict=False)) if not _alike(*pair)), None)
        same = min(len(ours), len(theirs)) if same is None else same
        gone, new = len(theirs) - same, ours[same:]
        if self.body != before.body or gone > session.cuts:
            return None
        if gone == 1 and len(new) == 1:
            return [partial(session.cut, new[0], extend=True)]
        return [session.undo] * gone + [partial(session.cut, blade) for blade in new]


def read_organ(data: bytes) -> RoomOrgan:
    """The organ that a room has sent. Raises `DataError` if another version has written it."""
    try:
        (length,) = struct.unpack_from("<I", data)
        header: dict[str, Any] = json.loads(data[4 : 4 + length])
    except (struct.error, ValueError):
        raise DataError(REFUSED) from None
    if header.get("protocol") != PROTOCOL:
        raise DataError(
            "the room is served by another version of palpate, whose messages differ; install the same one at both ends"
        )
    try:
        return _organ(header, data[4 + length :])
    except PalpateError:
        raise
    except (KeyError, ValueError, TypeError):
        raise DataError(REFUSED) from None


def _organ(header: dict[str, Any], rest: bytes) -> RoomOrgan:
    at = 0

    def array(kind: str, *shape: int) -> Any:
        nonlocal at
        values = np.frombuffer(rest, kind, int(np.prod(shape)), at).reshape(shape)
        at += values.nbytes
        return values

    nodes, tets, triangles = (header[name] for name in ("nodes", "tets", "triangles"))
    corners = array("<f8", header["blade"], 3, 3) if header["blade"] else np.empty((0, 3, 3))
    places, lam, mu = array("<f8", nodes, 3), array("<f8", tets), array("<f8", tets)
    tough = array("<f8", header["regions"])
    tet, region = array("<i4", tets, 4), array("<i4", tets)
    for count in (3 * triangles, header["shown"]):
        array("<i4", count)  # the surface and what is shown follow from the mesh
    labels = array("<i4", header["regions"])
    sizes = array("<i4", header["cuts"]) if header["cuts"] else np.empty(0, np.int32)
    held = array("u1", nodes) > 0
    names = {int(label): part["name"] for label, part in zip(labels, header["parts"], strict=True)}
    young = mu * (3 * lam + 2 * mu) / (lam + mu) / KPA
    ends = np.cumsum(sizes)
    radius, limit, friction = (float(header[name]) for name in ("radius", "limit", "friction"))
    blade_friction = float(header["description"]["settings"]["blade_friction"])
    return RoomOrgan(
        Tissue(TetMesh(places, tet, region, names), young, lam / (2 * (lam + mu)), held),
        tuple(_blade(corners[end - size : end]) for size, end in zip(sizes, ends, strict=True)),
        radius,
        limit,
        friction,
        dict(zip(labels.tolist(), tough.tolist(), strict=True)),
        blade_friction,
        b"".join(
            a.tobytes()
            for a in (places, lam, mu, tough, tet, region, held, np.array([radius, limit, friction, blade_friction]))
        ),
    )


def _blade(corners: Any) -> Blade:
    """Of (F, 3, 3) corners: those at one place are one."""
    points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Blade(points, index.reshape(-1, 3))


def _alike(one: Blade, other: Blade) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.triangles, other.triangles)
