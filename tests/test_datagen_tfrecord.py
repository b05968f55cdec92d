"""TFRecord and protocol buffers byte by byte: published checksums, and messages written out by hand."""

import struct

import pytest

from datagen.files.tfrecord import crc32c, masked, parse_example, read_records, write_example, write_records
from physics.schema import InputError
from tests.test_datagen_deepmind import slow_crc


@pytest.mark.parametrize(("data", "crc"), [
    # RFC 3720, appendix B.4, as in crc32c_test.cc of LevelDB; the check value 123456789 of the Rocksoft catalogue
    (bytes(32), 0x8A9136AA), (b"\xff" * 32, 0x62A8AB43), (bytes(range(32)), 0x46DD794E), (bytes(range(31, -1, -1)), 0x113FDB5C),
    (b"123456789", 0xE3069283), (b"", 0),
    (bytes.fromhex("01c00000 00000000 00000000 00000000 14000000 00000400 00000014 00000018 28000000 00000000 02000000 00000000"),
     0xD9963A56)])
def test_the_checksum_has_its_published_values(data, crc):
    assert crc32c(data) == crc


def test_the_mask_turns_the_checksum_and_adds_a_number():
    """0xE3069283 turned right by 15 bits is 0x2507C60D (0xE3069283 >> 15 = 0x1C60D; its low 15 bits, 0x1283, moved up by 17 are
    0x25060000); with 0xA282EAD8 that is 0xC78AB0E5. And 0x8A9136AA: 0x11522 | 0x6D540000 = 0x6D551522, with the number 0x10FD7FFFA
    less 2^32."""
    assert masked(b"123456789") == bytes.fromhex("e5b08ac7")
    assert masked(bytes(32)) == struct.pack("<I", 0x0FD7FFFA)
    assert masked(b"") == struct.pack("<I", 0xA282EAD8)


@pytest.mark.parametrize("size", [1, 1023, 1024, 8191, 8192, 8193, 9215, 9216, 13_000])
def test_the_checksum_by_lanes_is_that_bit_by_bit(size):
    """1024 lanes from 8 bytes each on, and what does not fill a lane."""
    data = bytes((31 * i * i + 7 * i + 3) % 251 for i in range(size))
    assert crc32c(data) == slow_crc(data)


def test_a_record_is_length_guard_data_guard(tmp_path):
    """`length` is 9 in eight bytes, the smallest first."""
    assert write_records(tmp_path / "f", iter([b"123456789", b""])) == 2
    expected = bytes.fromhex("0900000000000000") + masked(bytes([9]) + bytes(7)) + b"123456789" + bytes.fromhex("e5b08ac7")
    expected += bytes(8) + masked(bytes(8)) + struct.pack("<I", 0xA282EAD8)
    assert (tmp_path / "f").read_bytes() == expected
    assert list(read_records(tmp_path / "f")) == [b"123456789", b""]
    assert write_records(tmp_path / "empty", []) == 0 and list(read_records(tmp_path / "empty")) == []


def test_every_flipped_bit_and_every_cut_of_a_file_is_seen(tmp_path):
    write_records(tmp_path / "f", [b"first", b"second one"])
    data, ends = (tmp_path / "f").read_bytes(), (0, 21, 47)
    assert len(data) == 47
    for place in range(len(data)):
        for bit in (1, 128):
            damaged = bytearray(data)
            damaged[place] ^= bit
            (tmp_path / "f").write_bytes(damaged)
            with pytest.raises(InputError, match=f"record {int(place >= 21)} is cut short or damaged"):
                list(read_records(tmp_path / "f"))
    for size in range(len(data)):
        (tmp_path / "f").write_bytes(data[:size])
        if size in ends:
            assert len(list(read_records(tmp_path / "f"))) == ends.index(size)
        else:
            with pytest.raises(InputError, match=f"record {int(size > 21)} is cut short or damaged"):
                list(read_records(tmp_path / "f"))
    with pytest.raises(InputError, match=r"none: No such file or directory"):
        list(read_records(tmp_path / "none"))


BYTES = ("0a0d" "0a0b"      # Example.features, 13 bytes; Features.feature, a pair of 11
         "0a0161" "1206"    # its key "a"; its value, a Feature of 6
         "0a04" "0a027879")  # Feature.bytes_list, 4; BytesList.value "xy"


def test_an_example_written_out_by_hand():
    assert write_example({"a": b"xy"}) == bytes.fromhex(BYTES)
    assert parse_example(bytes.fromhex(BYTES)) == {"a": [b"xy"]}
    two = bytes.fromhex("0a1a" + BYTES[4:] + BYTES[4:].replace("61", "62").replace("7879", "7a7b"))
    assert write_example({"a": b"xy", "b": b"z{"}) == two and parse_example(two) == {"a": [b"xy"], "b": [b"z{"]}
    assert write_example({}) == b"\x0a\x00" and parse_example(b"") == {}


@pytest.mark.parametrize(("size", "prefix"), [(0, "00"), (127, "7f"), (128, "8001"), (300, "ac02"), (16383, "ff7f"), (16384, "808001")])
def test_lengths_are_varints(size, prefix):
    """Seven bits a byte, the lowest first, the eighth set when more follow; 300 is protobuf.dev's own example."""
    data = bytes(size)
    said = write_example({"a": data})
    assert said.endswith(b"\x0a" + bytes.fromhex(prefix) + data) and parse_example(said) == {"a": [data]}


def test_a_list_may_have_several_values_and_a_message_its_fields_in_any_order():
    """The key after its value, an int64_list and a float_list beside (fields 3 and 2), a bytes_list in two parts."""
    feature = "0a020a00" "1a0308ac02" "0a060a01780a0179" "12060a0400000000"
    pair = f"12{len(feature) // 2:02x}{feature}" "0a0162"
    assert parse_example(bytes.fromhex(f"0a{len(pair) // 2 + 2:02x}0a{len(pair) // 2:02x}{pair}")) == {"b": [b"", b"x", b"y"]}


@pytest.mark.parametrize(("before", "kind"), [("48ac02", 0), ("49" + 8 * "00", 1), ("4a03010203", 2), ("4d" + 4 * "00", 5)])
def test_fields_of_other_numbers_are_skipped_whole(before, kind):
    """Number 9 of each wire type, and number 1 of a type that is no message, before, and after."""
    for text in (before + BYTES, BYTES + before):
        assert parse_example(bytes.fromhex(text)) == {"a": [b"xy"]}
    if kind != 2:
        assert parse_example(bytes.fromhex(f"{8 | kind:02x}" + before[2:] + BYTES)) == {"a": [b"xy"]}


@pytest.mark.parametrize(("text", "words"), [
    ("0b", "wire type 3"), ("0c", "wire type 4"), ("0e", "wire type 6"), ("0a0361", "longer than its message"), ("0a02", "longer"),
    ("49" + 7 * "00", "longer"), ("4d" + 3 * "00", "longer"), ("0a", "does not end"), ("0a80", "does not end"), ("80", "does not end"),
    ("48" + 10 * "80" + "00", "does not end"), (BYTES[:-2], "longer")])
def test_what_is_no_example_is_refused(text, words):
    with pytest.raises(InputError, match=f"not a tf.train.Example: .*{words}"):
        parse_example(bytes.fromhex(text))


def test_a_number_has_ten_bytes_at_most():
    assert parse_example(bytes.fromhex("48" + 9 * "ff" + "01")) == {}  # 2^64 - 1
    with pytest.raises(InputError, match="does not end"):
        parse_example(bytes.fromhex("48" + 10 * "ff" + "01"))
