"""States in files: what is written is read again, and nothing else is."""

import io
import json
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch

from causal_openlock.files.state import StateError, open_archive, read_state, write_state
from support.checkpoints import same


def write(path, state):
    with path.open("wb") as file:
        write_state(file, state)
    return path


def test_a_state_reads_back_as_what_it_was(tmp_path):
    state = {
        "plain": [None, True, 3, -0.1, float("inf"), "é", 2**127, (1, (2,), [])],
        3: {"bytes": b"\x00\xff", (1, 2): {}},
        "arrays": [np.arange(3, dtype=np.uint8), np.zeros((0, 4)), np.array(2.5), np.array(["a"])],
        "turned": np.arange(6).reshape(2, 3).T,
        "number": np.float32(0.1),
        "tensors": (torch.arange(4).reshape(2, 2).T, torch.tensor(1.5), torch.tensor([True])),
        "generator": np.random.default_rng(1).bit_generator.state,
    }
    again = read_state(write(tmp_path / "state", state))
    assert same(again, state)
    for name in ("plain", "arrays", "tensors"):
        assert [type(part) for part in again[name]] == [type(part) for part in state[name]]
    assert isinstance(again["number"], np.float32)
    for name in ("arrays", "tensors"):
        assert [part.dtype for part in again[name]] == [part.dtype for part in state[name]]


class Text(str):
    """No plain text."""


@pytest.mark.parametrize(
    "value", [{1}, np.array([{}]), object(), Text("a"), torch.zeros(1, dtype=torch.bfloat16)]
)
def test_what_is_not_plain_data_is_refused_by_its_place(tmp_path, value):
    with pytest.raises(StateError, match=r"state\.a\.1"):
        write(tmp_path / "state", {"a": [0, value]})


def test_no_flipped_bit_passes_for_what_was_written(tmp_path):
    state = {"weights": np.arange(6000.0).reshape(2, 3000), "steps": [3, None]}
    path = write(tmp_path / "state", state)
    content = path.read_bytes()
    places = range(len(content))
    noticed = 0
    # All that says what is where, and some of the numbers.
    for place in {*places[:600:2], *places[-400::2], *places[::1997]}:
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            assert same(read_state(path), state), place
        except StateError:
            noticed += 1
    assert noticed > 400


class Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


def archive(path, array, save=np.savez):
    outline = np.frombuffer(json.dumps(["array", "a0"]).encode(), np.uint8)
    with path.open("wb") as file:
        save(file, outline=outline, a0=array)
    return path


def test_reading_a_state_runs_no_code(tmp_path):
    path = archive(tmp_path / "state", np.array([Trap(tmp_path / "sprung")]))
    with pytest.raises(StateError):
        read_state(path)
    assert not (tmp_path / "sprung").exists()


def test_a_state_is_only_read_from_a_file_with_all_its_members(tmp_path):
    path = archive(tmp_path / "state", np.zeros(3))
    with zipfile.ZipFile(path) as packed:
        outline = packed.read("outline.npy")
    for members in ({}, {"outline.npy": outline}, {"outline.npy": outline, "../a0.npy": b"x"}):
        with zipfile.ZipFile(path, "w") as packed:
            for name, content in members.items():
                packed.writestr(name, content)
        with pytest.raises(StateError):
            read_state(path)
    assert [one.name for one in tmp_path.iterdir()] == ["state"]
    with pytest.raises(StateError):
        read_state(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_state(tmp_path / "none")


@pytest.mark.parametrize("packed", [False, True])
def test_a_state_takes_no_more_memory_than_its_file(tmp_path, packed):
    """A header that claims a terabyte; and 40 MB that are packed into 40 kB."""
    path = tmp_path / "state"
    if packed:
        archive(path, np.zeros(5_000_000), np.savez_compressed)
    else:
        content = archive(path, np.zeros(8, np.int8)).read_bytes()
        start = content.index(b"{'descr': '|i1', 'fortran_order': False, 'shape': (8,), }")
        header = b"{'descr': '|i1', 'fortran_order': False, 'shape': (1000000000000,), }"
        content = content[:start] + header + content[start + len(header) :]
        path.write_bytes(with_checksums(content))
    tracemalloc.start()
    try:
        with pytest.raises(StateError, match=r"another size than its header states|larger than"):
            read_state(path)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def with_checksums(content):
    """A stored archive whose checksums are right again."""
    changed = bytearray(content)
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        directory = packed.start_dir
        for about in packed.infolist():
            begin = about.header_offset
            name, extra = struct.unpack("<HH", content[begin + 26 : begin + 30])
            data = begin + 30 + name + extra
            checksum = zlib.crc32(content[data : data + about.file_size]).to_bytes(4, "little")
            changed[begin + 14 : begin + 18] = changed[directory + 16 : directory + 20] = checksum
            directory += 46 + sum(struct.unpack("<HHH", content[directory + 28 : directory + 34]))
    return bytes(changed)


@pytest.mark.parametrize("point", [0xD800, 0xDFFF, 0x110000, 0x7FFFFFFF])
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_text_that_is_not_unicode_is_refused(tmp_path, point, order):
    """NumPy makes a text of any number, and a validator written in Rust ends at it."""
    letters = np.array([ord("a"), point], np.dtype("u4").newbyteorder(order))
    np.savez(tmp_path / "a.npz", about=letters.view(np.dtype("U2").newbyteorder(order)).reshape(()))
    with (
        pytest.raises(StateError, match="not Unicode"),
        open_archive(tmp_path / "a.npz") as arrays,
    ):
        arrays.read("about")


def test_other_texts_are_read(tmp_path):
    np.savez(tmp_path / "one.npz", about=np.array("é 🙂 \U0010ffff"))
    with open_archive(tmp_path / "one.npz") as arrays:
        assert str(arrays.read("about")) == "é 🙂 \U0010ffff"
