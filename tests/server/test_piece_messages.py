"""What pages are told of pieces that cuts have freed: their shapes with the scene, and with each frame where they are."""

import json
import struct

import numpy as np
import pytest
from support.example_organs import organ

import palpate as pp
from palpate.errors import DataError
from palpate.server.frame_message import pieces_bytes
from palpate.server.message_checks import decode
from palpate.server.messages import BINARY, Pieces, ToolCommand, encode
from palpate.server.scene_message import scene_bytes
from palpate.simulation.pointer import PieceState


@pytest.fixture(scope="module")
def session():
    session = pp.Session(pp.model(organ(9), "compliance"), radius=9.0, sweeps=4)
    session.step([None])
    return session


@pytest.fixture(scope="module")
def cut(session):
    assert pieces_bytes(session.frame()) == b"", "no byte as long as there are none"
    session.cut(pp.Blade.swept([(-200, -200, 10), (200, -200, 10)], (0, 1, 0), 400))
    session.step([None])
    return session


def test_the_scene_has_their_shapes(cut):
    data = scene_bytes(cut, "Organ")
    (length,) = struct.unpack_from("<I", data)
    scene, piece = json.loads(data[4 : 4 + length]), cut.pieces[0]
    assert [one["nodes"] for one in scene["pieces"]] == [len(piece.places)]
    assert scene["pieces"][0]["lips"] == list(piece.drawn.lips)
    at = 4 + length + 12 * (scene["nodes"] + scene["triangles"])
    nodes, triangles = scene["pieces"][0]["nodes"], scene["pieces"][0]["triangles"]
    assert len(data) == at + 24 * nodes + 12 * triangles
    rest, as_freed = np.frombuffer(data, "<f4", 6 * nodes, at).reshape(2, nodes, 3)
    faces = np.frombuffer(data, "<u4", 3 * triangles, at + 24 * nodes).reshape(-1, 3)
    assert np.array_equal(rest, as_freed), "nobody held it"
    assert np.linalg.det(rest[faces].astype(float)).sum() / 6 == pytest.approx(piece.volume, rel=1e-4)


def test_each_frame_says_where_they_are(cut):
    at = cut.pieces[0].drawn.places[0]
    cut.step([pp.Command(True, tuple(at), (1.0, 2.0, 20.0), "carry")] * 600)
    data = pieces_bytes(cut.frame())
    assert data[0] == BINARY.index(Pieces) + 1
    assert struct.unpack_from("<II", data, 1) == (cut.bodies, 1)
    row = np.frombuffer(data, "<f4", 4, len(data) - 16)
    assert row == pytest.approx([int(PieceState.carried), 1, 2, 20], abs=1e-5)


def test_a_page_may_carry_but_commands_no_blade_of_its_own():
    carry = ToolCommand(0, 5, 7, (1.0, 2.0, 3.0), (0.0, 0.0, 4.0))
    assert decode(encode(carry)) == carry
    for kind in (4, 6):
        with pytest.raises(DataError, match="ToolCommand"):
            decode(encode(ToolCommand(0, kind, 7, (1.0, 2.0, 3.0), (0.0, 0.0, 4.0))))
