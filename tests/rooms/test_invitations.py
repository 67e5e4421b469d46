"""Invitations: what a signed one says, and that nothing else lets anybody in."""

import base64
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import palpate as pp
from palpate.rooms.invitation import LONGEST, Invitation, invitation, read_invitation, sign
from palpate.server.message_kinds import Role

SECRET, OTHER = "a secret", "another secret"
names = st.text(st.characters(codec="utf-8", categories=("L", "N", "P")), max_size=20)


@given(names, st.sampled_from(list(Role)), names, st.integers(1, 2**33))
def test_what_was_signed_is_read_until_it_is_over(room, role, name, expires):
    one = Invitation(room, role, name, float(expires))
    signed = sign(one, SECRET)
    assert read_invitation(signed, SECRET, expires - 1) == one
    assert signed != sign(one, SECRET)  # no two are the same
    with pytest.raises(pp.errors.DataError, match="over"):
        read_invitation(signed, SECRET, expires)
    with pytest.raises(pp.errors.DataError, match="not valid"):
        read_invitation(signed, OTHER, expires - 1)


@given(st.integers(0, 10**6), st.integers(0, 255))
def test_one_that_was_changed_anywhere_is_none(place, letter):
    signed = sign(Invitation("anatomy", Role.viewer, "Ada", 2e9), SECRET)
    at = place % len(signed)
    changed = signed[:at] + chr(letter) + signed[at + 1 :]
    if changed != signed:
        with pytest.raises(pp.errors.DataError, match="not valid"):
            read_invitation(changed, SECRET, 1e9)


@given(st.text(max_size=2 * LONGEST) | st.sampled_from(["", ".", "..", "e30.", "a" * 10_000, "é." * 9]))
def test_any_other_text_is_none(text):
    with pytest.raises(pp.errors.DataError, match="not valid"):
        read_invitation(text, SECRET, 0)


def test_a_higher_role_needs_the_secret():
    signed = sign(Invitation("anatomy", Role.viewer, "Ada", 2e9), SECRET)
    text, signature = signed.split(".")
    told = json.loads(base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)))
    told[1] = int(Role.teacher)
    forged = base64.urlsafe_b64encode(json.dumps(told, separators=(",", ":")).encode()).decode().rstrip("=")
    for one in (f"{forged}.{signature}", forged, f"{forged}.", f"{text}.{signature}.{signature}"):
        with pytest.raises(pp.errors.DataError, match="not valid"):
            read_invitation(one, SECRET, 1e9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"role": "surgeon"}, "role: 'surgeon' is none; choose one of viewer, trainee, teacher"),
        ({"hours": 0}, "hours"),
        ({"hours": float("nan")}, "hours"),
        ({"hours": 1e9}, "hours"),
        ({"name": "a\nb"}, "name"),
        ({"name": "x" * 41}, "name"),
    ],
)
def test_what_cannot_be_is_refused(given, said):
    with pytest.raises(pp.errors.DataError, match=said):
        invitation("anatomy", **{"role": "trainee", **given})
