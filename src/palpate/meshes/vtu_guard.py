"""Refuses a .vtu file for which a reader would take what memory there is: streams that swell, entities, endless nesting."""

import base64
import lzma
import mmap
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from xml.parsers import expat

from palpate.bounded_read import NEST

ELEMENTS = 100_000  # of XML; a mesh has a dozen, and one a region
WORDS = {"UInt32": "I", "UInt64": "Q"}
STREAMS: dict[str, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}


class _Raw(Exception):  # noqa: N818
    """Raised where raw bytes begin, after which the file is no XML."""


def check_vtu(path: Path) -> None:
    """Raises `ValueError`, and expat's error, if the file should not be unpacked, or is no XML."""
    with path.open("rb") as file:
        said, texts, start = _walk(file)
        if said.get("compressor", "") not in STREAMS:
            return
        order = ">" if said.get("byte_order") == "BigEndian" else "<"
        word, stream = order + "{}" + WORDS[said.get("header_type", "UInt32")], STREAMS[said["compressor"]]
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
            data = whole.find(b"_", start) + 1
            for text, offset in texts:
                _check_blocks(
                    word, stream, partial(_take, whole, data + offset) if text is None else _taker(text[offset:])
                )


def _walk(file: Any) -> tuple[dict[str, str], list[tuple[str | None, int]], int]:
    """What the file says of itself; its packed arrays, text (None for raw bytes) and offset; where raw bytes begin."""
    said: dict[str, str] = {}
    texts: list[tuple[str | None, int]] = []
    offsets: list[int] = []
    count = depth = 0
    kept: list[str] | None = None

    def doctype(*_: object) -> None:
        raise ValueError("it declares a type of document, which a mesh does not need")

    def start(name: str, given: dict[str, str]) -> None:
        nonlocal count, depth, kept
        count, depth = count + 1, depth + 1
        if count > ELEMENTS or depth > NEST:
            raise ValueError(f"more than {ELEMENTS} elements, or more than {NEST} in each other")
        if name == "VTKFile":
            said.update(given)
        if name == "Piece" and min(int(given["NumberOfPoints"]), int(given["NumberOfCells"])) < 0:
            raise ValueError("a number of points or cells is negative")
        form = given.get("format") if name == "DataArray" else None
        if form == "appended":
            offsets.append(int(given["offset"]))
        if name == "AppendedData" and given.get("encoding") == "raw":
            raise _Raw
        if "compressor" in said and (form == "binary" or name == "AppendedData"):
            kept = []

    def end(name: str) -> None:
        nonlocal depth, kept
        depth -= 1
        if kept is not None:
            text = "".join(kept).strip()
            texts.extend((text, at) for at in ([0] if name == "DataArray" else [1 + offset for offset in offsets]))
            kept = None

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler, parser.StartElementHandler, parser.EndElementHandler = doctype, start, end
    parser.CharacterDataHandler = lambda text: None if kept is None else kept.append(text)
    try:
        parser.ParseFile(file)
    except _Raw:
        return said, [*texts, *((None, offset) for offset in offsets)], parser.CurrentByteIndex
    return said, texts, 0


def _check_blocks(word: str, stream: Callable[[], Any], take: Callable[[int, int], bytes]) -> None:
    """An array is: number of blocks, bytes a block, bytes of the last if it is shorter, packed bytes of each; then they."""
    (count,) = struct.unpack(word.format(1), take(0, struct.calcsize(word.format(1))))
    end = struct.calcsize(word.format(3)) + count * struct.calcsize(word.format(1))
    head = take(0, end)
    if len(head) < end:
        raise ValueError(f"an array of {count} blocks, and {len(head)} bytes to tell their lengths")
    _, size, _, *lengths = struct.unpack(word.format(3 + count), head)
    body, at = memoryview(take(end, sum(lengths))), 0
    for length in lengths:
        if len(stream().decompress(body[at : at + length], size + 1)) > size:
            raise ValueError(f"a block goes on after the {size} bytes that are said to be in it")
        at += length


def _take(data: mmap.mmap, at: int, start: int, count: int) -> bytes:
    """Bytes of an array that begins at byte `at`."""
    return data[at + start : at + start + count]


def _taker(text: str) -> Callable[[int, int], bytes]:
    """The same of an array in base 64, whose head and whose blocks are each encoded by themselves."""

    def take(start: int, count: int) -> bytes:
        first, characters = -(-start // 3) * 4, -(-count // 3) * 4
        return base64.b64decode(text[first : first + characters])[:count]

    return take
