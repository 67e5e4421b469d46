"""Files that an exported page saves; that a session goes from page to score is tested with the page."""

import json

import pytest

import palpate as pp
from palpate.errors import FileError


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"version": 2}, "version"),
        ({"commands": [[0, 0, 1, 0, 0, None, 0, 0, 0]]}, "not finite"),
        ({"commands": [[0, 0, 999, 0, 0, 0, 0, 0, 0]]}, "tool or kind"),
        ({"commands": [[5, 0, 1, 0, 0, 0, 0, 0, 0]]}, "length"),
        ({"digests": [[100, "xyz"]]}, "no session"),
        ({"switches": [[-1, 1]]}, "switch"),
        ({"marks": [[99, 0, 0]]}, "marks"),
        ({"settings": None}, "no session"),
    ],
)
def test_a_file_that_no_page_saved_is_refused(change, words, tmp_path):
    good = {"format": "palpate page session", "version": 1, "model": "compliance", "tissue": "0", "instructions": "wasm",
            "settings": {}, "length": 5, "commands": [], "digests": [], "switches": [], "marks": []}  # fmt: skip
    path = tmp_path / "session.json"
    path.write_text(json.dumps(good))
    assert pp.read_record(path).length == 5
    path.write_text(json.dumps(good | change))
    with pytest.raises(FileError, match=words):
        pp.read_record(path)
    path.write_text(json.dumps(good)[:-20])
    with pytest.raises(FileError, match="no session"):
        pp.read_record(path)
