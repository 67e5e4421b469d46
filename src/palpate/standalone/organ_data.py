"""An organ that a page holds by itself: the scene, then the solid, then the rules of an exam, as bytes."""

import json
import struct
from collections.abc import Mapping

from palpate.meshes.separate_organs import main_regions
from palpate.server.cutting_stroke import first_depth, may_cut
from palpate.server.exam import Exam
from palpate.server.scene_message import scene_bytes
from palpate.server.solid_message import followed_model, solid_bytes
from palpate.simulation.lesson import TOOLS
from palpate.simulation.session import Session
from palpate.tissue.tissue import Tissue

# Of an organ that the page cuts. One of 19,700 was cut; its factor in double precision takes a fifth of a memory's 4 GB.
MOST_NODES = 20_000


def session_of(
    tissue: Tissue, radius: float | None = None, toughness: float | Mapping[int | str, float] | None = None
) -> Session:
    """A session of model `compliance`, which the page's engine repeats.

    Raises `MaterialError` for a tissue that the engine does not follow, `DataError` for a radius that is too large.
    """
    model = followed_model(tissue, "export", "serve it: palpate touch")
    return Session(model, radius=radius, sweeps=1, toughness=toughness)


def organ_data(session: Session, title: str, task: str = "") -> bytes:
    """The scene as the server sends it, then the solid. Both begin with their length, 32 bits."""
    tissue = session.first.tissue
    small = len(tissue.mesh.nodes) <= MOST_NODES
    one = len(main_regions(tissue.mesh)) == 1  # the page does not tell organs beside each other apart once one is cut
    cuts = may_cut(session) and small and one and tissue.surface_friction == 0  # and the engine's lips do not rub
    tools, depth = ((*TOOLS, "cut"), first_depth(session)) if cuts else (TOOLS, 0.0)
    return _joined(scene_bytes(session, title, task=task, tools=tools, depth=depth), solid_bytes(session))


def case_session(exam: Exam) -> Session:
    """The session of an exam's case in a page; what is inside is not drawn. Raises as `session_of`, and `DataError`."""
    model = followed_model(exam.case(), "export", "serve it: palpate lesson start")
    return Session(model, sweeps=1, regions=False)


def case_data(session: Session, exam: Exam) -> bytes:
    """Scene and solid of an exam's case, and then its rules, as web/src/engine/exam.ts reads them."""
    lesson = exam.lesson
    scene = scene_bytes(session, lesson.title, task=lesson.asked, tools=exam.tools, views=exam.views, exam=True)
    rules = {"tools": exam.tools, "claims": lesson.claims, "time": lesson.time, "lesson": exam.description}
    return _joined(scene, solid_bytes(session), json.dumps(rules).encode())


def _joined(*parts: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)
