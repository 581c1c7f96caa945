"""Pages of a file and the record of their checksums that follows them.

A checked file is an HDF5 file of `size` bytes, the image, and a trailer behind it that HDF5 ignores. The image is cut
into pages. A record holds the checksum of every page, and pages that are still to be written over those in the file:

    magic, size of the image, number of pages held | their numbers | their bytes | checksums of all pages
    | checksum of this record, its length, magic

The trailer is a record that holds no pages. A record with pages is a journal: it is the last thing in the file while
the pages it holds are written to their places, so that a process killed half-way leaves all of them.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from zlib import crc32

import numpy as np

PAGE = 8192
_HEAD = struct.Struct("<8sQQ")
_FOOT = struct.Struct("<IQ8s")
_MAGIC, _END = b"mbvipage", b"mbviends"
# pages read at once
_MANY = 128


@dataclass(frozen=True)
class Record:
    """The contents of a record.

    Attributes
    ----------
    size : int
        Bytes of the image.
    pages : dict of int to bytes
        Pages that replace those in the file.
    sums : ndarray of uint32, shape (number of pages,)
        Checksum of every page.
    """

    size: int
    pages: dict[int, bytes]
    sums: np.ndarray


def page_count(size: int) -> int:
    """Return how many pages an image of `size` bytes has."""
    return -(-size // PAGE)


def page_length(page: int, size: int) -> int:
    """Return how many bytes of a page lie within an image of `size` bytes."""
    return min(PAGE, size - page * PAGE)


def record_length(size: int) -> int:
    """Return the length in bytes of a record without pages."""
    return _HEAD.size + 4 * page_count(size) + _FOOT.size


def pack(size: int, sums: np.ndarray, pages: Mapping[int, bytes | bytearray]) -> bytes:
    """Return a record; see `Record`."""
    numbers = np.array(sorted(pages), dtype="<u8")
    body = b"".join(
        [
            _HEAD.pack(_MAGIC, size, len(numbers)),
            numbers.tobytes(),
            *(bytes(pages[k][: page_length(k, size)]) for k in numbers.tolist()),
            np.ascontiguousarray(sums, dtype="<u4").tobytes(),
        ]
    )
    return body + _FOOT.pack(crc32(body), len(body) + _FOOT.size, _END)


def unpack(raw: bytes) -> Record | None:
    """Return the record at the beginning of `raw`, or None if it is incomplete."""
    if len(raw) < _HEAD.size + _FOOT.size:
        return None
    magic, size, count = _HEAD.unpack_from(raw)
    if magic != _MAGIC or count > page_count(size) or record_length(size) > len(raw):
        return None
    at = _HEAD.size + 8 * count
    if at > len(raw):
        return None
    numbers = np.frombuffer(raw, "<u8", count, _HEAD.size).tolist()
    if any(k >= page_count(size) for k in numbers):
        return None
    lengths = [page_length(k, size) for k in numbers]
    end = at + sum(lengths) + 4 * page_count(size)
    if end + _FOOT.size > len(raw):
        return None
    total, length, magic = _FOOT.unpack_from(raw, end)
    if magic != _END or length != end + _FOOT.size or total != crc32(raw[:end]):
        return None
    pages = {}
    for k, n in zip(numbers, lengths, strict=True):
        pages[k] = raw[at : at + n]
        at += n
    return Record(size, pages, np.frombuffer(raw, "<u4", page_count(size), at))


def find_record(file: int) -> tuple[Record | None, bool]:
    """Find the last valid record of a file.

    Parameters
    ----------
    file : int
        Descriptor of an open file.

    Returns
    -------
    record : Record or None
        The last whole one, or None if there is none.
    damaged : bool
        Whether there are marks of a record, but no whole one.
    """
    total = os.fstat(file).st_size
    foot = os.pread(file, _FOOT.size, max(total - _FOOT.size, 0))
    marked = foot.endswith(_END)
    if marked and len(foot) == _FOOT.size:
        _, length, _ = _FOOT.unpack(foot)
        if length <= total:
            found = unpack(_read(file, total - length, length))
            if found is not None:
                return found, False
    # a killed process can leave the beginning of a record behind the trailer
    size = _size_by_superblock(file)
    if size is not None and size < total:
        head = os.pread(file, _HEAD.size, size)
        if head.startswith(_MAGIC):
            found = unpack(_read(file, size, min(record_length(size), total - size)))
            return found, found is None
    return None, marked


def damaged_pages(file: int, record: Record) -> int:
    """Return how many pages of the file differ from their checksums."""
    wrong, count = 0, page_count(record.size)
    for first in range(0, count, _MANY):
        start, stop = first * PAGE, min((first + _MANY) * PAGE, record.size)
        block = memoryview(_read(file, start, stop - start))
        for page in range(first, min(first + _MANY, count)):
            here = record.pages.get(page, block[page * PAGE - start : (page + 1) * PAGE - start])
            wrong += len(here) != page_length(page, record.size) or crc32(here) != record.sums[page]
    return wrong


def sums_of(pages: Iterable[bytes | bytearray | memoryview]) -> np.ndarray:
    """Return the checksum of each page, shape (number of pages,)."""
    return np.array([crc32(page) for page in pages], dtype="<u4")


def _read(file: int, offset: int, length: int) -> bytes:
    parts = []
    while length > 0:
        part = os.pread(file, min(length, 1 << 26), offset)
        if not part:
            break
        parts.append(part)
        offset, length = offset + len(part), length - len(part)
    return b"".join(parts)


def _size_by_superblock(file: int) -> int | None:
    """Return the size of the image that its HDF5 superblock of version 2 names, or None."""
    head = os.pread(file, 36, 0)
    if len(head) < 36 or head[:9] != b"\x89HDF\r\n\x1a\n\x02":
        return None
    return int.from_bytes(head[28:36], "little")
