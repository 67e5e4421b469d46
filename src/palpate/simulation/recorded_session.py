"""Makes a new session that can replay a record."""

from palpate.simulation.recording import Record
from palpate.simulation.session import Session
from palpate.simulation.session_compatibility import check_record, model_settings, recorded_settings
from palpate.tissue.models.registry import model as build
from palpate.tissue.tissue import Tissue


def session_like(record: Record, tissue: Tissue, tension: float = 0.0) -> Session:
    """A new session that can replay the record. Raises `DataError` if it was made on another tissue."""
    model = build(tissue, record.model, **model_settings(record))
    session = Session(model, **recorded_settings(record), tension=tension)
    session.use_weights_of(record)
    check_record(record, session.first, session.settings)
    return session
