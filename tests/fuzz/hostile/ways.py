"""What the formats share: the list of cases, compressed streams that swell, and files that are no files."""

import functools
import gzip
import lzma
import os
import socket
import zlib

CASES = {}  # (format, class) to function(folder, rng), which writes a file into the folder and returns its name
COMMANDS = {}  # format to the words after `palpate` that read the file NAME
VALID = {}  # format to function(folder), which writes a file that is as it should be and returns its name
CLASSES = ("swelling", "special", "2^40", "wrapping", "header", "content")
MB = 2**20
SWOLLEN = 4096  # MB that come out of a stream which is said to hold less


def case(form, kind):
    """Registers a case of a format, of one of the classes."""
    assert kind in CLASSES, kind

    def add(make):
        assert (form, kind) not in CASES, (form, kind)
        CASES[form, kind] = make
        return make

    return add


def pick(rng, things):
    """One of a sequence, as it is."""
    return things[int(rng.integers(len(things)))]


@functools.cache
def zeros(level=9):
    """A megabyte of zeros as blocks of a raw deflate stream that can be repeated."""
    stream = zlib.compressobj(level, zlib.DEFLATED, -zlib.MAX_WBITS)
    return stream.compress(bytes(MB)) + stream.flush(zlib.Z_FULL_FLUSH)


@functools.cache
def swollen_deflate(start=b"", megabytes=SWOLLEN):
    """A raw deflate stream: `start`, then megabytes of zeros."""
    stream = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS)
    head = stream.compress(start) + stream.flush(zlib.Z_FULL_FLUSH)
    return head + zeros() * megabytes + zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS).flush()


@functools.cache
def swollen_zlib(start=b"", megabytes=SWOLLEN):
    """The same behind zlib's two bytes; its checksum is wrong, but comes last."""
    return zlib.compress(b"")[:2] + swollen_deflate(start, megabytes) + bytes(4)


@functools.cache
def swollen_gzip(start=b"", megabytes=SWOLLEN):
    """The same behind gzip's header."""
    return gzip.compress(b"", mtime=0)[:10] + swollen_deflate(start, megabytes) + bytes(8)


@functools.cache
def swollen_lzma(megabytes=1024):
    """A stream of LZMA, megabytes of zeros."""
    stream = lzma.LZMACompressor(preset=0)
    return b"".join(stream.compress(bytes(MB)) for _ in range(megabytes)) + stream.flush()


def special(path, rng):
    """No regular file at `path`: a pipe, a folder, a socket, or a device behind a link."""
    kind = pick(
        rng, ("pipe", "pipe", "folder", "socket", "/dev/zero", "/dev/zero", "/dev/null", "/dev/full", "/dev/tty")
    )
    path.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "socket":
        here = os.getcwd()
        os.chdir(path.parent)  # a socket's name may have 108 bytes
        try:
            with socket.socket(socket.AF_UNIX) as made:
                made.bind(path.name)
        finally:
            os.chdir(here)
    else:
        path.symlink_to(kind)


def deep(rng, opening, inner="", closing=""):
    """A text nested some ten thousand times."""
    depth = int(rng.integers(5_000, 100_000))
    return opening * depth + inner + closing * depth


def grown(path, size):
    """Makes a file longer, by zeros that take no place on the disk."""
    with path.open("r+b") as file:
        file.truncate(size)
