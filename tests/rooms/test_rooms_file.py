"""Lists of rooms."""

from pathlib import Path

import pytest

import palpate as pp


def written(tmp_path, text):
    path = tmp_path / "rooms.yaml"
    path.write_text("palpate rooms: 1\n" + text)
    return path


def test_rooms_are_read_with_files_beside_the_list(tmp_path):
    path = written(
        tmp_path,
        "rooms:\n  anatomy: {organs: [a.vtu, b.vtu], record: r.h5, tension: 2}\n  second: {organs: c.vtu, title: An organ}\n",
    )
    first, second = pp.read_rooms(path)
    assert first == pp.RoomFile(
        "anatomy", (tmp_path / "a.vtu", tmp_path / "b.vtu"), "anatomy", tension=2, record=tmp_path / "r.h5"
    )
    assert second == pp.RoomFile("second", (tmp_path / "c.vtu",), "An organ")
    (lecture,) = pp.read_rooms(written(tmp_path, "rooms:\n  lecture: {organs: [a.vtu], replay: [mine.h5, hers.h5]}\n"))
    assert lecture.replay == (tmp_path / "mine.h5", tmp_path / "hers.h5")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected `palpate rooms: 1` and `rooms:`"),
        ("rooms: {}", "expected one to 64 names"),
        ("rooms: [anatomy]", "expected one to 64 names"),
        ("rooms: {a: {}}", "organs: expected names of tissues"),
        ("rooms: {a: kidney.vtu}", "expected {organs:"),
        ("rooms: {a: {organs: [1]}}", "organs: expected names"),
        ("rooms: {a: {organs: [k.vtu], colour: red}}", "colour: no such key; there are organs"),
        ("rooms: {a: {organs: [k.vtu], radius: -1}}", "radius: '-1'; expected a number"),
        ("rooms: {a: {organs: [k.vtu], tension: true}}", "tension"),
        ("rooms: {a: {organs: [k.vtu], toughness: -164}}", "toughness: '-164'; expected a number"),
        ("rooms: {a: {organs: [k.vtu], toughness: {lump: -9}}}", "toughness: lump: '-9'; expected a number"),
        ("rooms: {a: {organs: [k.vtu], toughness: {1: 9}}}", "toughness: expected names of regions"),
        ("rooms: {a: {organs: [k.vtu], title: 7}}", "title: expected a text"),
        ("rooms: {'a b': {organs: [k.vtu]}}", "expected a name of letters"),
        ("rooms: {a: {organs: [k.vtu], replay: 3}}", "replay: expected recorded sessions"),
        ("rooms: {a: {organs: [k.vtu], replay: []}}", "replay: expected recorded sessions"),
        ("rooms: {a: {organs: [k.vtu], replay: [a, b, c]}}", "up to 2 stand side by side"),
        ("rooms: {a: {organs: [k.vtu], replay: a.h5, record: b.h5}}", "those of what is replayed"),
        ("rooms: {a: {organs: [k.vtu], record: r.h5}, b: {organs: [k.vtu], record: ./r.h5}}", "write the same file"),
        ("more: 1\nrooms: {a: {organs: [k.vtu]}}", "expected `palpate rooms: 1` and `rooms:`"),
    ],
)
def test_a_wrong_list_is_refused_by_its_name_and_its_place(tmp_path, text, said):
    path = written(tmp_path, text)
    with pytest.raises(pp.errors.DataError) as refusal:
        pp.read_rooms(path)
    assert str(path) in str(refusal.value)
    assert said in str(refusal.value)


def test_a_room_without_organs_is_none():
    with pytest.raises(pp.errors.DataError, match="organs: none"):
        pp.RoomFile("anatomy", ())
    assert pp.RoomFile("anatomy", (Path("kidney.vtu"),)).title == "anatomy"
