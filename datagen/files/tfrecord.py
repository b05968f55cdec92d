"""TFRecord files of tf.train.Example records, read and written without TensorFlow.

A file is a row of records: length (8 bytes, little-endian), masked CRC-32C of these 8 bytes (4), data, masked CRC-32C of the
data (4); masked(c) = ((c >> 15 | c << 17) + 0xa282ead8) mod 2^32. The data is a protocol buffer

    Example  { Features features = 1; }         Feature { BytesList bytes_list = 1; FloatList float_list = 2;
    Features { map<string, Feature> feature = 1; }        Int64List int64_list = 3; }     each list { repeated value = 1; }

of which only bytes_list is used by mesh data sets: the raw bytes of an array. Sources: TensorFlow, record_writer.h,
example.proto, feature.proto; the wire format at protobuf.dev; CRC-32C (Castagnoli): RFC 3720, appendix B.4.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.schema import InputError

POLYNOMIAL = 0x82F63B78  # CRC-32C, bits reversed
LANES = 1024


def _table() -> NDArray[np.uint32]:
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, table >> 1 ^ np.uint32(POLYNOMIAL), table >> 1).astype(np.uint32)
    return table


TABLE = _table()


def crc32c(data: bytes) -> int:
    """CRC-32C of some bytes.

    The remainder is linear over GF(2), so the data is cut into lanes whose remainders are computed side by side, from a
    register of zero, and joined: that of a followed by b is that of a moved on by len(b) zero bytes, plus that of b.
    """
    register, length = 0xFFFFFFFF, len(data) // LANES
    if length >= 8:
        lanes = np.frombuffer(data, np.uint8, LANES * length).reshape(LANES, length)
        state = np.zeros(LANES, np.uint32)
        for column in lanes.T:
            state = TABLE[(state ^ column) & 0xFF] ^ state >> 8
        moved = [_moved(1 << bit, length) for bit in range(32)]
        for lane in state.tolist():
            on = 0
            for bit in range(32):
                if register >> bit & 1:
                    on ^= moved[bit]
            register = on ^ lane
        data = data[LANES * length:]
    for byte in data:
        register = int(TABLE[(register ^ byte) & 0xFF]) ^ register >> 8
    return register ^ 0xFFFFFFFF


def _moved(register: int, count: int) -> int:
    """A register after so many zero bytes, by repeated squaring of the matrix of one."""
    matrix = np.array([int(TABLE[(1 << bit) & 0xFF]) ^ (1 << bit) >> 8 for bit in range(32)], np.uint32)  # images of the bits
    while count:
        if count & 1:
            register = int(_apply(matrix, np.array([register], np.uint32))[0])
        matrix, count = _apply(matrix, matrix), count >> 1
    return register


def _apply(matrix: NDArray[np.uint32], vectors: NDArray[np.uint32]) -> NDArray[np.uint32]:
    bits = (vectors[:, None] >> np.arange(32, dtype=np.uint32) & 1).astype(bool)
    return np.bitwise_xor.reduce(np.where(bits, matrix, np.uint32(0)), axis=1)


def masked(data: bytes) -> bytes:
    """The four bytes that guard some data."""
    crc = crc32c(data)
    return struct.pack("<I", ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF)


def read_records(path: str | Path) -> Iterator[bytes]:
    """The records of a file, one after another. Raises `InputError` when it is missing, cut short or damaged."""
    try:
        with open(path, "rb") as file:
            number = 0
            while head := file.read(12):
                if len(head) < 12 or masked(head[:8]) != head[8:]:
                    raise InputError(f"{path}: record {number} is cut short or damaged at its length")
                size = int.from_bytes(head[:8], "little")
                data, guard = file.read(size), file.read(4)
                if len(data) < size or masked(data) != guard:
                    raise InputError(f"{path}: record {number} is cut short or damaged")
                yield data
                number += 1
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def write_records(path: str | Path, records: Iterable[bytes]) -> int:
    """Write records to a file; their number. Raises OSError."""
    count = 0
    with open(path, "wb") as file:
        for data in records:
            length = struct.pack("<Q", len(data))
            file.write(length + masked(length) + data + masked(data))
            count += 1
    return count


def parse_example(data: bytes) -> dict[str, list[bytes]]:
    """The features of an Example that are lists of bytes. Raises `InputError` when the bytes are no such message."""
    found = {}
    for features in _fields(data, 1):
        for pair in _fields(features, 1):
            name, feature = b"".join(_fields(pair, 1)).decode(), b"".join(_fields(pair, 2))
            found[name] = [value for values in _fields(feature, 1) for value in _fields(values, 1)]
    return found


def write_example(features: dict[str, bytes]) -> bytes:
    """An Example with a list of one entry for each feature."""
    pairs = b"".join(_field(1, _field(1, name.encode()) + _field(2, _field(1, _field(1, value)))) for name, value in features.items())
    return _field(1, pairs)


def _fields(message: bytes, wanted: int) -> list[bytes]:
    """The values of one length-delimited field of a message, in order; other fields are skipped."""
    found, at = [], 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        if kind == 0:
            _, at = _varint(message, at)
            continue
        if kind == 2:
            size, at = _varint(message, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
        else:
            raise InputError(f"not a tf.train.Example: wire type {kind}")
        if at + size > len(message):
            raise InputError("not a tf.train.Example: a field is longer than its message")
        if kind == 2 and key >> 3 == wanted:
            found.append(message[at:at + size])
        at += size
    return found


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if at >= len(message) or shift > 63:
            raise InputError("not a tf.train.Example: a number does not end")
        byte = message[at]
        value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
        if byte < 0x80:
            return value, at


def _field(number: int, value: bytes) -> bytes:
    """A length-delimited field."""
    return _as_varint(number << 3 | 2) + _as_varint(len(value)) + value


def _as_varint(value: int) -> bytes:
    said = bytearray()
    while value > 0x7F:
        said.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*said, value])
