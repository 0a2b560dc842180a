"""Array files: arrays of NumPy, and structures in files of MATLAB, of bounded size; nothing is unpickled."""

from __future__ import annotations

import io
import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES

_MAT_HEAD, _MAT_TAG = 128, 8
"""Bytes of the head of a file of MATLAB 5, and of the tag of an element."""
_COMPRESSED = 15
"""Type of a compressed element."""


def npy_array(path: Path) -> FloatArray:
    """Return an array of real numbers that NumPy wrote.

    Raises
    ------
    MissionError
        If the file is none, holds objects, or states a larger size than it has.
    """
    content = read_whole(path, MAX_BYTES)
    stream = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(stream)
        read_head = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, order, dtype = read_head(stream)
    except Exception as error:  # a damaged head raises whatever the parser of Python happens to meet
        raise MissionError(f"{path}: is no array of NumPy: {error}") from error
    if dtype.kind not in "fiu" or math.prod(shape) * dtype.itemsize != len(content) - stream.tell():
        raise MissionError(
            f"{path}: states {shape} of {dtype}, and has {len(content) - stream.tell()} bytes; accepted are "
            "real numbers, as many as are stated"
        )
    values = np.frombuffer(content, dtype, offset=stream.tell())
    return values.reshape(shape, order="F" if order else "C").astype(np.float64)


def mat_structure(
    path: Path, name: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, FloatArray]:
    """Return fields of a structure in a file of MATLAB 5, as arrays (n, k) of real numbers.

    The elements are decompressed here, up to a limit, before they are parsed.

    Raises
    ------
    MissionError
        If the file is no such file, or the structure or a needed field is missing or not of real numbers.
    """
    from scipy.io import loadmat  # noqa: PLC0415 - takes a while to import

    plain = _decompress_file(path, read_whole(path, MAX_BYTES))
    try:
        file: Any = io.BytesIO(plain)
        found = loadmat(file, variable_names=[name], struct_as_record=True)[name]
        fields: Mapping[str, Any] = {field: found[field].item() for field in found.dtype.names or ()}
    except Exception as error:  # a damaged file raises whatever the parser happens to meet
        raise MissionError(
            f"{path}: has no structure {name} that can be read ({type(error).__name__}: {error})"
        ) from error
    missing = [field for field in needed if field not in fields]
    if missing:
        raise MissionError(
            f"{path}: structure {name} has no field {missing[0]}; accepted are structures with "
            f"{', '.join(needed)}"
        )
    return {
        field: _require_real(path, field, fields[field]) for field in (*needed, *optional) if field in fields
    }


def _require_real(path: Path, field: str, values: Any) -> FloatArray:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.ndim != 2 or not array.size:
        raise MissionError(f"{path}: field {field} is no table of real numbers; accepted is one")
    return array.astype(np.float64)


def _decompress_file(path: Path, content: bytes) -> bytes:
    """Return a file of MATLAB 5 without compressed elements, whose sizes together are bounded."""
    if content[:6] != b"MATLAB" or content[126:128] != b"IM":
        raise MissionError(
            f"{path}: is no file of MATLAB 5, little-endian; accepted is what save writes without -v7.3"
        )
    parts, at, left = [content[:_MAT_HEAD]], _MAT_HEAD, MAX_BYTES
    while at + _MAT_TAG <= len(content):
        kind, size = struct.unpack_from("<II", content, at)
        body = content[at + _MAT_TAG : at + _MAT_TAG + size]
        if len(body) < size:
            raise MissionError(f"{path}: ends within an element of {size} bytes")
        if kind == _COMPRESSED:
            stream = zlib.decompressobj()
            try:
                part = stream.decompress(body, left)
            except zlib.error as error:
                raise MissionError(f"{path}: a compressed element is damaged: {error}") from error
            if stream.unconsumed_tail:
                raise MissionError(
                    f"{path}: accepted are files up to {MAX_BYTES // 2**20} MB when decompressed"
                )
        else:
            part = content[at : at + _MAT_TAG + size]
        left -= len(part)
        parts.append(part)
        at += _MAT_TAG + size
    return b"".join(parts)
