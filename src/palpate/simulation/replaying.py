"""A fresh session that can repeat a recorded one."""

from palpate.simulation.likeness import agrees, model_settings, recorded_settings
from palpate.simulation.record import Record
from palpate.simulation.session import Session
from palpate.tissue.models import model as build
from palpate.tissue.tissue import Tissue


def like(record: Record, tissue: Tissue) -> Session:
    """A fresh session that can replay the record. Raises `DataError` if it was made on another tissue."""
    model = build(tissue, record.model, **model_settings(record))
    session = Session(model, **recorded_settings(record))
    agrees(record, session.first, session.settings)
    return session
