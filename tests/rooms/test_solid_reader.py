"""What a site that predicts has to do when its room's organ has other cuts."""

import pytest
from support.example_organs import organ

import palpate as pp
from palpate.rooms.solid_reader import RoomOrgan

ORGAN = organ(5)
BLADES = {
    name: pp.Blade.swept([(x, -40, 40), (x, 40, 40)], (0, 0, -1), 25) for name, x in zip("abcd", range(4), strict=True)
}


class Steps:
    """Writes down what a session is told to do; cuts: how many it has."""

    def __init__(self, cuts):
        self.cuts, self.told = cuts, []

    def undo(self):
        self.told.append("undo")
        return True

    def cut(self, blade, extend=False):
        name = next(name for name, one in BLADES.items() if one is blade)
        self.told.append(f"{'extend' if extend else 'cut'} {name}")
        return True


def room_organ(blades, body=b"organ"):
    return RoomOrgan(ORGAN, tuple(BLADES[name] for name in blades), 9.0, 5.0, 0.3, {}, 0.0, body)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("", "", []),
        ("", "ab", ["cut a", "cut b"]),
        ("a", "ab", ["cut b"]),
        ("ab", "a", ["undo"]),
        ("ab", "", ["undo", "undo"]),
        ("ab", "ac", ["extend c"]),  # a stroke that went on is one cut, made anew
        ("abc", "ad", ["undo", "undo", "cut d"]),
        ("ab", "cd", ["undo", "undo", "cut c", "cut d"]),
    ],
)
def test_it_takes_back_what_is_gone_and_makes_what_is_new(before, after, told):
    session = Steps(len(before))
    for step in room_organ(after).cuts_from(room_organ(before), session):
        assert step()
    assert session.told == told


def test_another_organ_or_a_cut_that_is_not_its_own_is_made_from_the_start():
    assert room_organ("a").cuts_from(room_organ("a", b"another"), Steps(1)) is None
    assert room_organ("").cuts_from(room_organ("ab"), Steps(1)) is None
