"""The enumerations in the messages between page and server."""

from enum import IntEnum

from palpate.simulation.session import LUMP, SAMPLE


class SelectionKind(IntEnum):
    """What a `Selection` selects."""

    model = 0
    organ = 1


class CutStep(IntEnum):
    """What a `Scalpel` does."""

    begin = 0
    move = 1
    end = 2
    undo = 3


class NoteStep(IntEnum):
    """What a `Note` does."""

    add = 0
    remove = 1


class PlayStep(IntEnum):
    """What a `Play` does."""

    pause = 0
    play = 1
    speed = 2
    seek = 3


class MarkKind(IntEnum):
    """What a `Mark` says."""

    lump = LUMP
    sample = SAMPLE


class ComparisonState(IntEnum):
    """What a `Difference` holds."""

    preparing = 0
    compared = 1
    no_reference = 2
    contacts_overlap = 3


class TrialState(IntEnum):
    """What a forced-choice trial waits for: palpate, the answer, the end of a break, nothing any more."""

    preparing = 0
    asking = 1
    pause = 2
    ended = 3


class Feedback(IntEnum):
    """What is told of the last answer."""

    none = 0
    right = 1
    wrong = 2


class ChoiceKind(IntEnum):
    """What a `Choice` does."""

    show = 0
    answer = 1
    go_on = 2


class Role(IntEnum):
    """What a person may do in a room: watch, touch, or lead as well."""

    viewer = 0
    trainee = 1
    teacher = 2


class LeadStep(IntEnum):
    """What a `Lead` does."""

    freeze = 0
    resume = 1
    reset = 2
    take_over = 3
    release = 4
    guide = 5
    end_guidance = 6


class GuidanceState(IntEnum):
    """Whether a teacher guides a hand: nobody does, one will once both hold the organ, one does."""

    none = 0
    waiting = 1
    on = 2


class CloseCode(IntEnum):
    """Codes with which the server closes a page's WebSocket (RFC 6455; from 4000 on they are the application's)."""

    refused = 1008
    too_many_pages = 1013
    scene_changed = 4001
    room_lost = 4002
